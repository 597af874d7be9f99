use super::*;
use crate::build::manifest::Manifest;
use crate::io::grid::{RawLayout, SampleType};

const CLOTH: &str = "[volume.cloth]\ndensity = \"d.vol\"\nalbedo = [0.9, 0.8, 0.7]\nvoxel = 1e-5\nlevels = [2, 4]\n\
                     sggx = { fibre = \"f.vol\", along = 0.1 }\n";

fn volume(text: &str) -> VolumeSpec {
    Manifest::parse(text).unwrap().volumes.remove(0)
}

/// The messages of a manifest's mistakes.
fn mistakes(text: &str) -> Vec<String> {
    Manifest::parse(text).unwrap_err().iter().map(ToString::to_string).collect()
}

fn plain(file: &str) -> GridSpec {
    GridSpec { file: file.into(), layout: None }
}

#[test]
fn a_plain_volume_has_the_documented_defaults() {
    let cloth = volume(CLOTH);
    assert_eq!(cloth.density, DensitySpec { grid: plain("d.vol"), window: None, scale: 1.0 });
    assert_eq!(cloth.albedo, AlbedoSpec::Constant([0.9, 0.8, 0.7]));
    assert_eq!(cloth.sggx, SggxSpec::Fibres { directions: plain("f.vol"), along: AlongSpec::Constant(0.1) });
    assert_eq!((cloth.voxel, cloth.repeat, cloth.levels), ([1e-5; 3], [false; 3], vec![2, 4]));
    assert_eq!((cloth.lobes, cloth.clusters, cloth.optimizer), (None, None, Optimizer::LevenbergMarquardt));
    assert_eq!((cloth.error, cloth.seed), (crate::build::manifest::DEFAULT_ERROR, 0));
}

#[test]
fn every_key_reaches_the_volume() {
    let text = "[build]\nerror = 0.1\n[volume.ct]\n\
                density = { file = \"ct.tif\", window = [160, 90], scale = 4000 }\n\
                albedo = { file = \"a.raw\", size = [8, 7, 6], type = \"u8\" }\n\
                sggx = { from = \"structure-tensor\", sigma = 1.5, rho = 3, along = { file = \"along.raw\", \
                size = [8, 7, 6], type = \"f32\", order = \"zyx\", endian = \"big\" } }\n\
                voxel = [1e-5, 1e-5, 2e-5]\nlevels = [2, 4, 8]\nlobes = 2\nclusters = \"auto\"\noptimizer = \"sgd\"\n\
                repeat = [true, true, false]\nseed = 7\n";
    let ct = volume(text);
    assert_eq!(ct.density, DensitySpec { grid: plain("ct.tif"), window: Some([160.0, 90.0]), scale: 4000.0 });
    let layout = RawLayout { size: [8, 7, 6], sample: SampleType::U8, order: [0, 1, 2], is_big_endian: false };
    assert_eq!(ct.albedo, AlbedoSpec::Grid(GridSpec { file: "a.raw".into(), layout: Some(layout) }));
    let layout = RawLayout { sample: SampleType::F32, order: [2, 1, 0], is_big_endian: true, ..layout };
    let along = AlongSpec::Areas(GridSpec { file: "along.raw".into(), layout: Some(layout) });
    let settings = OrientationSettings { sigma: 1.5, rho: 3.0 };
    assert_eq!(ct.sggx, SggxSpec::StructureTensor { settings, along });
    assert_eq!((ct.voxel, ct.repeat), ([1e-5, 1e-5, 2e-5], [true, true, false]));
    assert_eq!(
        (ct.lobes, ct.clusters, ct.optimizer, ct.error, ct.seed),
        (Some(2), None, Optimizer::GradientDescent, 0.1, 7)
    );
}

#[test]
fn the_forms_of_sggx_are_told_apart() {
    let with = |sggx: &str| volume(&CLOTH.replace("{ fibre = \"f.vol\", along = 0.1 }", sggx)).sggx;
    assert_eq!(with("{ file = \"s.vol\" }"), SggxSpec::Matrices(plain("s.vol")));
    let directions = plain("f.vol");
    let along = AlongSpec::Eigenvalues(plain("e.vol"));
    assert_eq!(
        with("{ fibre = \"f.vol\", eigenvalue = \"e.vol\" }"),
        SggxSpec::Fibres { directions: directions.clone(), along }
    );
    let along = AlongSpec::Areas(plain("a.vol"));
    assert_eq!(with("{ fibre = \"f.vol\", along = \"a.vol\" }"), SggxSpec::Fibres { directions, along });
    let settings = OrientationSettings { sigma: 1.0, rho: 4.0 };
    let along = AlongSpec::Constant(0.2);
    assert_eq!(with("{ from = \"structure-tensor\", along = 0.2 }"), SggxSpec::StructureTensor { settings, along });
}

#[test]
fn names_are_unique_over_surfaces_and_volumes() {
    let surface = "[surface.cloth]\nheight = \"a.png\"\nsize = [1, 1]\namplitude = 0\nlevels = [8]\n\
                   bsdf = { type = \"diffuse\", albedo = [0.5, 0.5, 0.5] }\n";
    let found = mistakes(&format!("{CLOTH}{surface}"));
    assert_eq!(found, ["1:9: `cloth` is a surface and a volume; wanted names of their own"]);
    let found = mistakes(&format!("{CLOTH}{}", surface.replace("cloth", "Cloth")));
    assert_eq!(found, ["1:9: the names `Cloth` and `cloth` differ in case alone"]);
    let manifest = Manifest::parse(&format!("{CLOTH}{}", surface.replace("cloth", "bark"))).unwrap();
    assert_eq!((manifest.surfaces.len(), manifest.volumes.len()), (1, 1));
}
