use super::super::{Manifest, Mistake};
use super::*;

const SURFACES: &str = "[surface.twill]\nheight = \"twill.png\"\nsize = [0.01, 0.01]\namplitude = 0.0004\n\
                        bsdf = { type = \"diffuse\", albedo = [0.5, 0.4, 0.3] }\nlevels = [8]\n\
                        [surface.logo]\nheight = \"logo.png\"\nsize = [0.1, 0.1]\namplitude = 0.001\n\
                        boundary = \"clamp\"\nbsdf = { type = \"diffuse\", albedo = [1, 1, 1] }\nlevels = [8]\n";

const PLAIN: [(&str, &str); 3] = [
    ("camera", "{ position = [0, 0.3, 0.4], target = [0, 0, 0], fov = 40 }"),
    ("lights", "[{ type = \"constant\", radiance = [1, 1, 1] }]"),
    ("objects", "[{ mesh = \"plane\", surface = \"twill\" }]"),
];

/// The manifest of the scene `shop` that is plain but for these keys.
fn manifest_with(changes: &[(&str, &str)]) -> String {
    let is_changed = |key: &str| changes.iter().any(|(changed, _)| *changed == key);
    let plain = PLAIN.iter().filter(|(key, _)| !is_changed(key));
    let keys: String = changes.iter().chain(plain).map(|(key, value)| format!("{key} = {value}\n")).collect();
    format!("[scene.shop]\n{keys}{SURFACES}")
}

fn scene_with(changes: &[(&str, &str)]) -> SceneSpec {
    let text = manifest_with(changes);
    let mut scenes = Manifest::parse(&text).unwrap_or_else(|mistakes| panic!("{text}{mistakes:?}")).scenes;
    scenes.remove(0)
}

fn mistakes_with(changes: &[(&str, &str)]) -> Vec<Mistake> {
    Manifest::parse(&manifest_with(changes)).expect_err(&format!("{changes:?} should be refused"))
}

fn light(keys: &str) -> LightSpec {
    scene_with(&[("lights", &format!("[{{ {keys} }}]"))]).lights.remove(0)
}

#[test]
fn a_plain_scene_has_the_documented_defaults() {
    let scene = scene_with(&[]);
    assert_eq!((scene.name.as_str(), scene.film), ("shop", [256, 256]));
    let CameraSpec { position, target, up, projection } = scene.camera;
    assert_eq!((position, target, up), ([0.0, 0.3, 0.4], [0.0; 3], [0.0, 1.0, 0.0]));
    assert_eq!(projection, Projection::Perspective { fov_degrees: 40.0 });
    assert_eq!(scene.lights, [LightSpec::Constant { radiance: [1.0; 3] }]);
    assert_eq!(
        scene.objects,
        [ObjectSpec::Surface(PlaneSpec { surface: "twill".into(), tiling: [1, 1], displacement: None })]
    );
    let image = LightSpec::Image { file: "studio.exr".into(), scale: 1.0, rotation_degrees: 0.0 };
    assert_eq!(light("type = \"image\", file = \"studio.exr\""), image);
}

#[test]
fn every_key_reaches_the_scene() {
    let displacement = "{ file = \"large.exr\", amplitude = 0.02, channel = \"Y\", offset = -0.5 }";
    let object = format!("mesh = \"plane\", surface = \"twill\", tiling = [100, 1], displacement = {displacement}");
    let scene = scene_with(&[
        ("camera", "{ position = [1, 2, 3], target = [4, 5, 6], up = [0, 0, 2], width = 0.05 }"),
        ("film", "{ width = 640, height = 1 }"),
        ("objects", &format!("[{{ {object} }}]")),
    ]);
    assert_eq!(scene.film, [640, 1]);
    let CameraSpec { position, target, up, projection } = scene.camera;
    assert_eq!((position, target, up), ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [0.0, 0.0, 1.0]));
    assert_eq!(projection, Projection::Orthographic { width: 0.05 });
    let displacement =
        Displacement { file: "large.exr".into(), amplitude: 0.02, offset: -0.5, channel: Some("Y".into()) };
    let plane = PlaneSpec { surface: "twill".into(), tiling: [100, 1], displacement: Some(displacement) };
    assert_eq!(scene.objects, [ObjectSpec::Surface(plane)]);
}

#[test]
fn every_type_of_light_reaches_the_scene() {
    let [directional, area, constant, image] = [
        "type = \"directional\", direction = [0, 3, 4], irradiance = [3, 2, 1]",
        "type = \"area\", position = [0, 1, 0], target = [1, 1, 0], up = [0, 0, 5], size = [0.2, 0.1], \
         radiance = [5, 0, 1e9]",
        "type = \"constant\", radiance = [0, 0, 0.5]",
        "type = \"image\", file = \"studio.exr\", scale = 0.5, rotation = -90",
    ]
    .map(light);
    assert_eq!(directional, LightSpec::Directional { direction: [0.0, 0.6, 0.8], irradiance: [3.0, 2.0, 1.0] });
    let (position, target, up) = ([0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    assert_eq!(area, LightSpec::Area { position, target, up, size: [0.2, 0.1], radiance: [5.0, 0.0, 1e9] });
    assert_eq!(constant, LightSpec::Constant { radiance: [0.0, 0.0, 0.5] });
    assert_eq!(image, LightSpec::Image { file: "studio.exr".into(), scale: 0.5, rotation_degrees: -90.0 });
}

#[test]
fn what_looks_along_y_has_minus_z_up() {
    for [from, to] in [[[0.0, 1.0, 0.0], [0.0; 3]], [[2.0, -1.0, 3.0], [2.0, 7.0, 3.0]]] {
        let ends = format!("position = {from:?}, target = {to:?}");
        let scene = scene_with(&[("camera", &format!("{{ {ends}, fov = 40 }}"))]);
        assert_eq!(scene.camera.up, [0.0, 0.0, -1.0]);
        let area = light(&format!("type = \"area\", {ends}, size = [1, 1], radiance = [1, 1, 1]"));
        assert!(matches!(area, LightSpec::Area { up: [0.0, 0.0, -1.0], .. }), "{area:?}");
    }
    let oblique = scene_with(&[("camera", "{ position = [1e-5, 1, 0], target = [0, 0, 0], fov = 40 }")]);
    assert_eq!(oblique.camera.up, [0.0, 1.0, 0.0]);
}

#[test]
fn directions_of_any_length_come_out_with_unit_length() {
    for scale in ["1e-300", "1e-160", "1", "1e160", "1e300"] {
        let given = format!("[{}, {scale}, {scale}]", scale.replacen('1', "-1", 1));
        let light = light(&format!("type = \"directional\", direction = {given}, irradiance = [1, 1, 1]"));
        let LightSpec::Directional { direction, .. } = light else { panic!("{light:?}") };
        let third = 3.0_f64.sqrt().recip();
        let wanted = [-third, third, third];
        // One division and one square root, each to half a unit in the last place.
        assert!(direction.iter().zip(wanted).all(|(n, wanted)| (n - wanted).abs() < 4.0 * f64::EPSILON), "{given}");
    }
}

#[test]
fn values_are_accepted_up_to_their_limits_and_not_beyond() {
    let camera = |keys: &str| ("camera", format!("{{ position = [0, 1, 1], target = [0, 0, 0], {keys} }}"));
    let light = |keys: &str| ("lights", format!("[{{ {keys} }}]"));
    let directional =
        |y: &str| light(&format!("type = \"directional\", irradiance = [1, 1, 1], direction = [1, {y}, 0]"));
    let object = |keys: &str| ("objects", format!("[{{ mesh = \"plane\", {keys} }}]"));
    let lights = |n: usize| ("lights", format!("[{}]", "{ type = \"constant\", radiance = [1, 1, 1] },".repeat(n)));
    let film = |width: &str| ("film", format!("{{ width = {width} }}"));
    for (accepted, refused) in [
        (camera("fov = 1e-3"), camera("fov = 0")),
        (camera("fov = 179.999"), camera("fov = 180")),
        (camera("width = 1e9"), camera("width = 1.1e9")),
        (camera("width = 1, up = [0, 1, -1.00001]"), camera("width = 1, up = [0, 1, 1]")),
        (camera("width = 1, up = [0, 1, 0.9999]"), camera("width = 1, up = [0, -1, -1.0000001]")),
        (film("1"), film("0")),
        (film("16384"), film("16385")),
        (film("7"), film("7.0")),
        (lights(1), lights(0)),
        (lights(16), lights(17)),
        (directional("1e-5"), directional("0")),
        (directional("1e-5"), directional("1e-7")),
        (directional("1"), directional("-1")),
        (light("type = \"constant\", radiance = [0, 0, 1e9]"), light("type = \"constant\", radiance = [0, 0, 1.1e9]")),
        (light("type = \"constant\", radiance = [0, 0, 0]"), light("type = \"constant\", radiance = [0, -1e-9, 0]")),
        (object("surface = \"twill\", tiling = [1, 1000000]"), object("surface = \"twill\", tiling = [1, 1000001]")),
        (object("surface = \"twill\", tiling = [3, 1]"), object("surface = \"twill\", tiling = [3, 0]")),
        (object("surface = \"twill\", tiling = [3, 1]"), object("surface = \"twill\", tiling = [3]")),
        (object("surface = \"logo\", tiling = [1, 1]"), object("surface = \"logo\", tiling = [1, 2]")),
    ] {
        scene_with(&[(accepted.0, &accepted.1)]);
        let mistakes = mistakes_with(&[(refused.0, &refused.1)]);
        assert_eq!(mistakes.len(), 1, "{refused:?}: {mistakes:?}");
    }
}

#[test]
fn a_number_that_is_not_finite_is_refused_wherever_it_stands() {
    let scene = "[scene.shop]\ncamera = { position = [1, 2, 3], target = [4, 5, 6], up = [7, 8, 9], fov = 10 }\n\
                 film = { width = 11, height = 12 }\nlights = [\n\
                 { type = \"directional\", direction = [13, 14, 15], irradiance = [16, 17, 18] },\n\
                 { type = \"area\", position = [19, 20, 21], target = [22, 23, 24], size = [25, 26], \
                 radiance = [27, 28, 29] },\n{ type = \"image\", file = \"a.exr\", scale = 30, rotation = 31 },\n]\n\
                 objects = [{ mesh = \"plane\", surface = \"twill\", tiling = [32, 33], \
                 displacement = { file = \"b.exr\", amplitude = 34, offset = 35 } }]\n";
    assert_eq!(Manifest::parse(&(scene.to_owned() + SURFACES)).map(|manifest| manifest.scenes.len()), Ok(1));
    for n in 1..=35 {
        for not_finite in ["nan", "-inf", "1e999"] {
            let number =
                |before: &str, after: &str| (format!("{before}{n}{after}"), format!("{before}{not_finite}{after}"));
            let places = [number("[", ","), number(" ", ","), number(" ", "]"), number(" ", " ")];
            let (from, to) = places.iter().find(|(from, _)| scene.contains(from)).unwrap();
            let mistakes = Manifest::parse(&(scene.replacen(from, to, 1) + SURFACES)).expect_err(to);
            assert_eq!(mistakes.len(), 1, "{n} as {not_finite}: {mistakes:?}");
        }
    }
}

#[test]
fn arrays_may_be_written_as_tables_and_have_their_places() {
    let text = "[[scene.shop.lights]]\ntype = \"constant\"\nradiance = [1, 1, 1]\n[[scene.shop.lights]]\n\
                type = \"constant\"\nradiance = [1, 1]\n[[scene.shop.lights]]\ntype = \"image\"\n\
                [[scene.shop.objects]]\nmesh = \"plane\"\nsurface = \"twill\"\n\
                [scene.shop.camera]\nposition = [0, 1, 1]\ntarget = [0, 0, 0]\nwidth = 1\n";
    let mistakes = Manifest::parse(&(text.to_owned() + SURFACES)).unwrap_err();
    let shown: Vec<String> = mistakes.iter().map(ToString::to_string).collect();
    let wanted = [
        "6:12: `radiance` is `[1, 1]`; wanted three numbers from 0 to 1e9 (linear RGB)",
        "7:1: `light 3 of [scene.shop]` has no `file`; wanted the path of an equirectangular EXR or HDR image",
    ];
    assert_eq!(shown, wanted);
}

#[test]
fn a_scene_may_share_the_name_of_a_surface() {
    let text = manifest_with(&[]).replace("[scene.shop]", "[scene.twill]");
    let manifest = Manifest::parse(&text).unwrap();
    assert_eq!((manifest.scenes[0].name.as_str(), manifest.surfaces.len()), ("twill", 2));
}

#[test]
fn a_surface_with_mistakes_is_still_there_for_its_scene() {
    let text = manifest_with(&[]).replace("amplitude = 0.0004", "amplitude = -1");
    let mistakes = Manifest::parse(&text).unwrap_err();
    assert_eq!(mistakes.len(), 1, "{mistakes:?}");
    assert!(mistakes[0].message.starts_with("`amplitude`"), "{mistakes:?}");
}

#[test]
fn a_surface_that_a_mistake_of_syntax_swallowed_is_not_missed() {
    let text = manifest_with(&[]).replace("[surface.twill]", "[surface.twill");
    let mistakes = Manifest::parse(&text).unwrap_err();
    assert!(!mistakes.iter().any(|mistake| mistake.message.contains("no surface")), "{mistakes:?}");
}

#[test]
fn messages_stay_on_one_line() {
    let text = manifest_with(&[
        ("lights", "[{ type = \"moon\\nlight\" }]"),
        ("objects", "[{ mesh = \"a\\nb\", surface = \"c\\nd\", displacement = \"e\\nf\" }]"),
    ]);
    for text in [text.clone(), text.replace("[scene.shop]", "[scene.\"sh\\nop\"]\nshade = 1")] {
        let mistakes = Manifest::parse(&text).unwrap_err();
        assert!(mistakes.len() >= 4, "{mistakes:?}");
        assert!(mistakes.iter().all(|mistake| !mistake.message.contains('\n')), "{mistakes:?}");
    }
}

#[test]
fn a_manifest_cut_anywhere_is_read_without_a_panic() {
    let text = manifest_with(&[("film", "{ width = 640, height = 480 }")]);
    for end in 0..text.len() {
        let _ = Manifest::parse(&text[..end]);
    }
}
