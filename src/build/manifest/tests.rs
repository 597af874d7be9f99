use super::*;
use crate::geometry::Boundary;

fn mistakes(text: &str) -> Vec<String> {
    Manifest::parse(text).expect_err("the text has mistakes").iter().map(ToString::to_string).collect()
}

const WEAVE: &str = "[surface.weave]\nheight = \"a.png\"\nsize = [1, 2.5]\namplitude = 0.1\n\
                     bsdf = { type = \"diffuse\", albedo = [0.5, 0.4, 0.3] }\nlevels = [8]\n";

#[test]
fn a_plain_surface_has_the_documented_defaults() {
    let manifest = Manifest::parse(WEAVE).unwrap();
    let surface = &manifest.surfaces[0];
    assert_eq!(surface.boundary, Boundary::Repeat);
    assert_eq!(surface.size, [1.0, 2.5]);
    assert_eq!(surface.error, DEFAULT_ERROR);
    let level = surface.levels[0];
    assert_eq!((level.factor, level.patches, level.directions, level.rank, level.lobes), (8.0, 4, 15, 1, None));
}

#[test]
fn probe() {
    for text in [
        "[surface.weave\nheight = 3",
        "a = \n b = ]\n[surface.x]\n",
        "[surface.weave]\nheight = \"a\"\nheight = \"b\"\n",
        "[surface.weave]\n[surface.weave]\n",
        "surface = 3",
        "[surface]\nweave = 3",
        "",
        "[build]\nerror = 3\nerorr = 1\n[sruface.x]\n[volume.cloth]\n[scene.a]\n",
        "[surface.\"a/b\"]\nsize = [1e400, 0]\nlevels=\"auto\"\nlight=\"baked\"\nbsdf = {type=\"plastic\", ior=3}",
        "[surface.a]\nheight=3\nsize=\"x\"\namplitude=-1\nlevels=[8,4]\nlobes=9\nrank=0\ndirections=4\npatches=1.5\nseed=-1\nboundary=\"wrap\"\nbsdf={type=\"conductor\", distribution=\"beckmann\", roughness=[0.1,0.2], eta=3, albedo=[2,0,0]}\ninvert=1\nampltude=2\nfoo=1\nerror=0\noffset=nan\n[surface.A]\n",
    ] {
        println!("--- {text}");
        for m in mistakes(text) {
            println!("{m}");
        }
    }
}
