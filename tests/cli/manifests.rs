//! What is said about manifests.

use crate::project::Project;

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
        ("", "1:1: the manifest has no `[surface.NAME]` table; wanted at least one\n"),
        ("surface = 3\n", "1:1: `surface` is not a table; wanted `[surface.NAME]`\n"),
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
