//! Levels of volumes through the bytes of an asset: how large they are, and what rounding does to their images. And real CT
//! as it comes from a scanner, up to such a level.

use std::path::Path;

use farfield::build::Manifest;
use farfield::build::volume::encode::{medium_of, volume_asset, volume_level};
use farfield::build::volume::{VolumeAlbedo, VolumeInput, read};
use farfield::math::rng::Stream;
use farfield::math::warp;
use farfield::medium::{Medium, MediumShape, Voxel};
use farfield::transport::volume::means::{Observer, SmoothLight, Walks, follow};
use formats::asset::DOCUMENT;
use formats::symmetric::Eigen;
use formats::{FlakeLobe, Sggx, VolumeAsset};
use glam::Vec3;

const VOXEL: f64 = 1e-5;

/// Sums over the walks of a batch, `[light][rgb]`.
#[derive(Default)]
struct Sums([[f64; 3]; 2]);

/// The lights: an even sky, and one that is bright on one side.
fn lights() -> [SmoothLight; 2] {
    [SmoothLight::ONE, SmoothLight::tilted(Vec3::new(0.6, 0.0, 0.8))]
}

impl Observer for Sums {
    fn leaves(&mut self, _: usize, direction: Vec3, throughput: Vec3, _: f32) {
        for (sum, light) in self.0.iter_mut().zip(lights()) {
            (0..3).for_each(|c| sum[c] += f64::from(throughput[c] * light.radiance(direction)));
        }
    }
}

/// What the batches of walks over three views bring, batch by batch.
fn image(medium: &Medium, walks: usize) -> Vec<Sums> {
    let views = [Vec3::Z, Vec3::new(0.7, 0.2, 0.6), Vec3::new(-0.3, 0.8, -0.5)];
    let walks = Walks { count: walks, seed: 3 };
    views.into_iter().flat_map(|view| follow(medium, view.normalize(), walks, Sums::default)).collect()
}

/// Relative change of the mean in a channel under a light, and its standard error from pairs of batches, whose walks share
/// their random numbers.
fn change(was: &[Sums], is: &[Sums], light: usize, channel: usize) -> (f64, f64) {
    let total: f64 = was.iter().map(|sums| sums.0[light][channel]).sum();
    let differences: Vec<f64> =
        was.iter().zip(is).map(|(was, is)| is.0[light][channel] - was.0[light][channel]).collect();
    let sum: f64 = differences.iter().sum();
    let mean = sum / differences.len() as f64;
    let variance: f64 = differences.iter().map(|difference| (difference - mean).powi(2)).sum();
    (sum / total, variance.sqrt() / total)
}

/// A cloth of wavy fibres: `lobes` directions that cross in every voxel, albedos that vary from yarn to yarn.
fn cloth(size: [usize; 3], lobes: usize) -> Medium {
    let shape = MediumShape { size, voxel: [VOXEL; 3], repeat: [true, true, false] };
    Medium::new(shape, lobes, |[x, y, z]| {
        let stream = Stream::new(11, ((z * size[1] + y) * size[0] + x) as u64);
        let phase = |n: usize| n as f32 / 16.0 * std::f32::consts::TAU;
        let height = (phase(x).sin() + phase(y).cos()) * 0.2 + 0.5;
        let far = (z as f32 / size[2] as f32 - height).abs();
        let density = (2.0 - 8.0 * far) * (0.5 + stream.uniform(0)) / VOXEL as f32;
        let along = 0.08 + 0.2 * stream.uniform(1);
        let yarn = [0.95, 0.6, 0.2 + 0.6 * ((x / 4) % 2) as f32];
        let lobe = |axis: [f32; 3], area: f32, rgb: [f32; 3]| {
            let length = axis.iter().map(|a| a * a).sum::<f32>().sqrt();
            FlakeLobe { area, shape: Sggx::fibre(axis.map(|a| a / length), along), albedo: rgb }
        };
        let area = if lobes == 1 { 1.0 } else { 0.2 + 0.6 * stream.uniform(2) };
        let mut all = vec![lobe([1.0, 0.3 * phase(y).sin(), phase(x).cos()], area, yarn)];
        if lobes == 2 {
            all.push(lobe([0.1, 1.0, -phase(y).sin()], 1.0 - area, yarn.map(|a| 0.9 * a)));
        }
        (density > 0.0).then(|| Voxel::new(density, &all))
    })
}

/// The manifest of a volume whose files are not read.
fn any_volume() -> (farfield::build::VolumeSpec, VolumeInput) {
    let text = "[volume.cloth]\ndensity = \"d.vol\"\nalbedo = [0.5, 0.5, 0.5]\nvoxel = 1e-5\nlevels = [1]\n\
                repeat = [true, true, false]\nsggx = { file = \"s.vol\" }\n";
    let input = VolumeInput {
        size: [1; 3],
        voxel: [VOXEL; 3],
        repeat: [true, true, false],
        density: vec![0.0],
        albedo: VolumeAlbedo::Constant([0.5; 3]),
        shapes: vec![[0.0; 6]],
        density_digest: "0".repeat(64),
        digests: Default::default(),
        warnings: Vec::new(),
    };
    (Manifest::parse(text).unwrap().volumes.remove(0), input)
}

/// The medium as the reader of its asset has it, and the bytes of its payloads.
fn through_bytes(medium: &Medium) -> (Medium, usize) {
    let (spec, input) = any_volume();
    let files = volume_asset(&spec, &input, vec![volume_level(1, medium.shape().size, medium)]).encode().unwrap();
    let bytes = files.iter().filter(|(name, _)| *name != DOCUMENT).map(|(_, bytes)| bytes.len()).sum();
    let asset = VolumeAsset::decode(&mut |name| Ok(files[name].clone())).unwrap();
    (medium_of(&asset, &asset.levels[0]), bytes)
}

#[test]
fn rounding_changes_image_means_by_less_than_a_fifth_of_a_percent() {
    for lobes in [1, 2] {
        let medium = cloth([32, 32, 16], lobes);
        let (rounded, _) = through_bytes(&medium);
        assert_eq!((rounded.occupied(), rounded.shape()), (medium.occupied(), medium.shape()));
        let [was, is] = [&medium, &rounded].map(|medium| image(medium, 250_000));
        for (light, channel) in (0..6).map(|k| (k / 3, k % 3)) {
            let (change, error) = change(&was, &is, light, channel);
            println!("{lobes} lobes, light {light}, channel {channel}: {change:.5} ± {error:.5}");
            // The bar lies four standard errors from no change at all.
            assert!(error < 5.5e-4 && change.abs() < 2e-3, "{lobes} lobes, light {light}: {change} ± {error}");
        }
    }
}

#[test]
fn a_voxel_takes_at_most_twelve_bytes_with_one_lobe_and_twenty_with_two() {
    /// Densities, fibres and albedos without any order: what no compression can make smaller.
    fn chaos(lobes: usize) -> Medium {
        let shape = MediumShape { size: [48, 40, 32], voxel: [VOXEL; 3], repeat: [false; 3] };
        Medium::new(shape, lobes, |[x, y, z]| {
            let stream = Stream::new(5, ((z * 40 + y) * 48 + x) as u64);
            let lobe = |j: u64| FlakeLobe {
                area: 1.0 / lobes as f32,
                shape: Sggx::fibre(
                    warp::sphere(stream.uniform_pair(10 * j)).to_array(),
                    0.1 + 0.5 * stream.uniform(10 * j + 2),
                ),
                albedo: [3, 4, 5].map(|c| stream.uniform(10 * j + c)),
            };
            let all: Vec<FlakeLobe> = (0..lobes as u64).map(lobe).collect();
            Some(Voxel::new(1e5 * (0.01 + stream.uniform(99)), &all))
        })
    }
    for (lobes, most) in [(1, 12.0), (2, 20.0)] {
        for (name, medium) in [("cloth", cloth([64, 64, 24], lobes)), ("chaos", chaos(lobes))] {
            let (_, bytes) = through_bytes(&medium);
            let each = bytes as f64 / medium.occupied() as f64;
            println!("{name}, {lobes} lobes: {each:.2} bytes an occupied voxel");
            assert!(each <= most, "{name}, {lobes} lobes: {each}");
        }
    }
}

#[test]
fn a_medium_comes_back_voxel_by_voxel() {
    let medium = cloth([19, 10, 9], 2);
    let (rounded, _) = through_bytes(&medium);
    for index in 0..medium.occupied() {
        let [was, is] = [medium.voxel(index), rounded.voxel(index)];
        for k in 0..20 {
            let w = warp::sphere(Stream::new(k, index as u64).uniform_pair(0)).to_array();
            let sigma = |voxel: &Voxel| voxel.density * formats::sggx::projected_area(voxel.lobes(), w);
            // Rounding of M by half a code, of directions in which two fibres show a tenth at least.
            assert!((sigma(&is) / sigma(&was) - 1.0).abs() < 0.06, "{was:?} {is:?}");
        }
    }
}

#[test]
fn real_ct_becomes_fibres_along_its_plies() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/volumes");
    let text = "[volume.composite]\nalbedo = [0.9, 0.9, 0.9]\nvoxel = 1e-6\nlevels = [2]\n\
                density = { file = \"fibre_composite_64.tif\", window = [125, 175], scale = 1e6 }\n\
                sggx = { from = \"structure-tensor\", sigma = 1, rho = 4, along = 0.1 }\n";
    let spec = Manifest::parse(text).unwrap().volumes.remove(0);
    let input = read(&spec, &folder).unwrap();
    assert_eq!((input.size, input.warnings.len()), ([64; 3], 0));
    let share = input.occupied() as f64 / input.density.len() as f64;
    assert!((0.4..0.9).contains(&share), "{share}");
    // The plies lie across one axis: hardly a fibre points along it, and two directions share the rest.
    let mut orientation = [0.0; 6];
    for (s, _) in input.shapes.iter().zip(&input.density).filter(|(_, density)| **density > 0.0) {
        (0..6).for_each(|k| orientation[k] += (f64::from(u8::from(k < 3)) - f64::from(s[k])) / 0.99);
    }
    let values = Eigen::of(orientation.map(|sum| sum / input.occupied() as f64)).values;
    println!("orientation tensor: {values:.3?}");
    assert!(values[2] < 0.03 && values[1] > 0.2 && (values.iter().sum::<f64>() - 1.0).abs() < 1e-3, "{values:?}");

    let medium = input.medium();
    assert_eq!(medium.occupied(), input.occupied());
    let asset = volume_asset(&spec, &input, vec![volume_level(1, input.size, &medium)]);
    let files = asset.encode().unwrap();
    let decoded = VolumeAsset::decode(&mut |name| Ok(files[name].clone())).unwrap();
    assert_eq!(decoded.levels[0].occupied.len(), input.occupied());
    let bytes: usize = files.values().map(Vec::len).sum();
    println!("{:.2} bytes an occupied voxel", bytes as f64 / input.occupied() as f64);
    assert!(bytes <= 12 * input.occupied());
}
