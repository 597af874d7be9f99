//! What is said about manifests.

use crate::project::{Project, surface};

/// Runs `build` on a manifest with mistakes and gives what it says.
fn complaints(manifest: &str) -> String {
    let project = Project::empty();
    project.write("farfield.toml", manifest.as_bytes());
    let said = project.run(&["build"]);
    assert_eq!((said.code, said.stdout.as_str()), (2, ""), "{said:?}");
    assert_eq!(project.tree("").len(), 1, "nothing is written");
    said.stderr
}

#[test]
fn every_mistake_is_reported_at_once() {
    let manifest = include_str!("every_mistake.toml");
    assert_eq!(complaints(manifest), include_str!("every_mistake.txt"));
}

#[test]
fn mistakes_of_syntax_have_a_place() {
    for (manifest, wanted) in [
        ("", "1:1: the manifest has no `[surface.NAME]` and no `[volume.NAME]` table; wanted at least one\n"),
        ("surface = 3\n", "1:1: `surface` is not a table; wanted `[surface.NAME]`\n"),
        ("scene = 3\n[surface]\n", "1:1: `scene` is not a table; wanted `[scene.NAME]`\n"),
        ("[surface]\n[scene]\nshop = 3\n", "3:1: `scene.shop` is not a table; wanted `[scene.shop]`\n"),
        ("[surface]\nbark = 3\n", "2:1: `surface.bark` is not a table; wanted `[surface.bark]`\n"),
        ("[surface.bark]\nheight = \"a\"\nheight = \"b\"\n", "3:1: the key is given twice; wanted it once\n"),
        ("[surface.bark]\n[surface.bark]\n", "2:10: the key is given twice; wanted it once\n"),
    ] {
        assert_eq!(complaints(manifest), format!("error: farfield.toml:{wanted}"));
    }
    for (manifest, place) in [("[surface.bark\nheight = 3\n", "1:"), ("a = 1\nb = ]\n", "2:5: "), ("\"\n", "1:")] {
        let said = complaints(manifest);
        assert!(said.contains(&format!("error: farfield.toml:{place}")), "{said}");
    }
}

#[test]
fn a_manifest_that_is_no_text_is_one_line() {
    let project = Project::empty();
    project.write("farfield.toml", &[b'a', 0xff]);
    let said = project.run(&["build"]);
    assert_eq!(
        (said.code, said.stderr.as_str()),
        (2, "error: `farfield.toml`: byte 1 is not UTF-8; wanted a text file\n")
    );
    let said = project.run(&["build", "-m", "."]);
    assert_eq!((said.code, said.stderr.as_str()), (2, "error: `.`: is a directory; wanted a file\n"));
    let said = project.run(&["build", "-m", "no.toml"]);
    let wanted = "error: `no.toml`: cannot be read: no such file or directory; `farfield init` makes one, `-m FILE` \
                  names another\n";
    assert_eq!((said.code, said.stderr.as_str()), (2, wanted));
}

/// A scene of the surface `waves`, with these keys beside its own.
fn scene(name: &str, keys: &str) -> String {
    format!(
        "[scene.{name}]\ncamera = {{ position = [0, 0.1, 0.1], target = [0, 0, 0], fov = 40 }}\n\
         lights = [{{ type = \"constant\", radiance = [1, 1, 1] }}]\n\
         objects = [{{ mesh = \"plane\", surface = \"waves\" }}]\n{keys}"
    )
}

#[test]
fn building_ignores_scenes_but_not_their_mistakes() {
    let project = Project::waves();
    let plain = project.run(&["build", "--dry-run"]);
    let manifest = surface("waves", "waves.png") + &scene("shop", "");
    project.write("farfield.toml", manifest.as_bytes());
    let said = project.run(&["build", "--dry-run"]);
    assert_eq!((said.code, said.stderr.as_str(), said.stdout), (0, "", plain.stdout));

    let manifest = surface("waves", "waves.png") + &scene("shop", "fog = 1\n");
    project.write("farfield.toml", manifest.as_bytes());
    let said = project.run(&["build"]);
    let wanted = "error: farfield.toml:14:1: unknown key `fog` in `[scene.shop]`; wanted one of `camera`, `film`, \
                  `lights`, `objects`\n";
    assert_eq!((said.code, said.stderr.as_str()), (2, wanted));
}

#[test]
fn a_scene_that_is_not_there_is_explained() {
    let project = Project::waves();
    let render = |scene: &str| {
        let said = project.run(&["render", scene, "-o", "image.exr"]);
        assert_eq!((said.code, said.stdout.as_str()), (2, ""), "{said:?}");
        assert!(!project.path().join("image.exr").exists());
        said.stderr
    };
    assert_eq!(render("shop"), "error: `farfield.toml` has no scene `shop`; wanted a `[scene.shop]` table\n");
    let manifest = surface("waves", "waves.png") + &scene("shop", "") + &scene("shelf", "");
    project.write("farfield.toml", manifest.as_bytes());
    assert_eq!(render("shops"), "error: `farfield.toml` has no scene `shops`; did you mean `shop`?\n");
    assert_eq!(render("garden"), "error: `farfield.toml` has no scene `garden`; it has `shelf`, `shop`\n");
}

#[test]
fn verify_explains_names_and_levels_that_are_not_there() {
    let project = Project::waves();
    for (arguments, wanted) in [
        (&["verify", "wave"][..], "`farfield.toml` has no surface `wave`; did you mean `waves`?"),
        (&["verify", "--level", "3"], "`--level` is 3; wanted 1 to 2, the levels of the manifest"),
    ] {
        let said = project.run(arguments);
        assert_eq!((said.code, said.stderr), (2, format!("error: {wanted}\n")));
    }
}
