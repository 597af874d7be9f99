use super::*;
use crate::geometry::Boundary;

const WEAVE: &str = "[surface.weave]\nheight = \"a.png\"\nsize = [1, 2.5]\namplitude = 0.1\n\
                     bsdf = { type = \"diffuse\", albedo = [0.5, 0.4, 0.3] }\nlevels = [8]\n";

#[test]
fn a_plain_surface_has_the_documented_defaults() {
    let manifest = Manifest::parse(WEAVE).unwrap();
    let surface = &manifest.surfaces[0];
    assert_eq!(surface.boundary, Boundary::Repeat);
    assert_eq!(surface.size, [1.0, 2.5]);
    assert_eq!(surface.error(), DEFAULT_ERROR);
    assert_eq!(surface.brdf.diffuse, [0.5, 0.4, 0.3]);
    let level = surface.levels[0];
    assert_eq!((level.factor, level.patches, level.directions, level.rank, level.lobes), (8.0, None, None, None, None));
    assert_eq!(level.fixed_sizes([9, 9]), None);
}

#[test]
fn every_key_reaches_the_surface() {
    let text = "[build]\nerror = 0.1\n[surface.weave]\nheight = \"a.exr\"\nchannel = \"R\"\ninvert = true\n\
                size = [0x1, 1_0.5]\namplitude = 2\noffset = -1\nboundary = \"clamp\"\ncolor = \"c.png\"\n\
                light = \"direct\"\nlevels = [2.5, 8]\ndetrend = true\ndequantize = true\npatches = 8\n\
                directions = 21\nrank = 3\nlobes = 6\nseed = 7\n\
                bsdf.type = \"conductor\"\nbsdf.roughness = 0.3\nbsdf.specular = [1, 0.5, 0]\nbsdf.albedo = [0, 0, 0.1]\n";
    let surface = &Manifest::parse(text).unwrap().surfaces[0];
    assert_eq!((surface.channel.as_deref(), surface.invert), (Some("R"), true));
    assert_eq!((surface.size, surface.amplitude, surface.offset), ([1.0, 10.5], 2.0, -1.0));
    assert_eq!((surface.boundary, surface.color.as_deref()), (Boundary::Clamp, Some("c.png")));
    assert_eq!((surface.detrend, surface.dequantize, surface.error()), (true, true, 0.1));
    let specular = surface.brdf.specular.unwrap();
    assert_eq!((specular.alpha, specular.f0, surface.brdf.diffuse), (0.3, [1.0, 0.5, 0.0], [0.0, 0.0, 0.1]));
    let [first, second] = surface.levels.as_slice() else { panic!("two levels") };
    assert_eq!((first.factor, second.factor), (2.5, 8.0));
    assert_eq!(
        (first.patches, first.directions, first.rank, first.lobes, first.seed),
        (Some(8), Some(21), Some(3), Some(6), 7)
    );
}

#[test]
fn sizes_may_be_left_open_by_name() {
    let text = "[surface.a]\nheight = \"a.exr\"\nsize = [1, 1]\namplitude = 1\nlevels = [8]\npatches = \"auto\"\n\
                directions = \"auto\"\nrank = 2\nbsdf = { type = \"diffuse\", albedo = [1, 1, 1] }\n";
    let level = Manifest::parse(text).unwrap().surfaces[0].levels[0];
    assert_eq!((level.patches, level.directions, level.rank), (None, None, Some(2)));
    assert!(Manifest::parse(&text.replace("patches = \"auto\"", "patches = \"many\"")).is_err());
}

#[test]
fn near_names_are_suggested_and_far_ones_are_not() {
    let known = ["amplitude", "size", "offset"];
    assert_eq!(closest("ampltude", &known), Some("amplitude"));
    assert_eq!(closest("Size", &known), Some("size"));
    assert_eq!(closest("foo", &known), None);
}

#[test]
fn columns_count_characters() {
    let mistakes = Manifest::parse("\"äöü\" = 1\n[surface.\"ä\"]\n").unwrap_err();
    let places: Vec<_> = mistakes.iter().map(|m| (m.line, m.column)).collect();
    assert!(places.contains(&(1, 1)) && places.contains(&(2, 10)), "{mistakes:?}");
}
