//! Volumes that are written come back, equal but for the rounding that the format states; how much that rounding is.

mod sample_volume;

use farfield_formats::asset::{DOCUMENT, Kind};
use farfield_formats::volume::{VolumeAsset, quantised_voxel};
use farfield_formats::{Error, FlakeLobe, Sggx, sggx};
use sample_volume::{Random, Sample};
use std::collections::BTreeMap;

fn decode(files: &BTreeMap<String, Vec<u8>>) -> Result<VolumeAsset, Error> {
    VolumeAsset::decode(&mut |path| Ok(files[path].clone()))
}

fn variants() -> [Sample; 5] {
    [
        Sample::SMALL,
        Sample::ROOMY,
        Sample { lobes: 1, filled: 1.0, size: [1, 1, 1], ..Sample::SMALL },
        Sample { filled: 0.0, ..Sample::ROOMY },
        Sample { lobes: 3, albedo: Some([0.95, 0.5, 0.0]), ..Sample::ROOMY },
    ]
}

fn direction(random: &mut Random) -> [f32; 3] {
    let [x, y, z] = random.direction();
    if random.unit() < 0.5 { [x, y, z] } else { [x, y, -z] }
}

#[test]
fn volumes_come_back_as_their_stated_rounding() {
    for sample in variants() {
        let asset = sample.asset();
        let files = asset.encode().unwrap();
        assert_eq!(Kind::of(&files[DOCUMENT]).unwrap(), Kind::Volume);
        let found = decode(&files).unwrap();
        let bare = |asset: &VolumeAsset| VolumeAsset { levels: Vec::new(), ..asset.clone() };
        assert_eq!(bare(&found), bare(&asset));
        let ([is], [was]) = (&found.levels[..], &asset.levels[..]) else { panic!("one level") };
        assert_eq!((&is.occupied, is.size, is.factor, is.index), (&was.occupied, was.size, was.factor, was.index));
        assert_eq!((&is.error, &is.fit, &is.limited_by), (&was.error, &was.fit, &was.limited_by));
        for voxel in 0..was.occupied.len() {
            let lobes: Vec<FlakeLobe> = was.lobes.iter().map(|lobe| lobe[voxel]).collect();
            let (density, wanted) = quantised_voxel(was.density[voxel], &lobes).unwrap();
            // Half an ulp of a half float, and of the f32 products on the way.
            assert!((is.density[voxel] / density - 1.0).abs() < 1.01 / 2048.0, "{density}");
            for (number, wanted) in wanted.iter().enumerate() {
                let lobe = &is.lobes[number][voxel];
                assert_eq!((lobe.area, lobe.shape), (wanted.area, wanted.shape));
                // A code of the largest range, and what the voxels before were rounded by.
                let turned = (0..3).map(|c| (lobe.albedo[c] - wanted.albedo[c]).abs()).fold(0.0, f32::max);
                assert!(lobe.area == 0.0 || turned <= 1.01 * 0.9 / 255.0, "{turned}");
            }
        }
    }
}

#[test]
fn constant_albedos_come_back_exactly_and_others_keep_their_mean() {
    let constant = Sample { albedo: Some([0.95, 0.123_456_7, 1.0]), ..Sample::ROOMY };
    let level = decode(&constant.asset().encode().unwrap()).unwrap().levels.remove(0);
    let used = level.lobes.iter().flatten().filter(|lobe| lobe.area > 0.0);
    assert!(used.clone().count() > 1000 && used.clone().all(|lobe| lobe.albedo == [0.95, 0.123_456_7, 1.0]));

    // An albedo between two codes all over a brick, with two voxels that set the range.
    let mut asset = Sample { lobes: 1, filled: 1.0, size: [8, 8, 8], ..Sample::SMALL }.asset();
    let level = &mut asset.levels[0];
    level.lobes[0].iter_mut().for_each(|lobe| lobe.albedo = [0.9503; 3]);
    level.lobes[0][0].albedo = [0.0; 3];
    level.lobes[0][1].albedo = [1.0; 3];
    let found = decode(&asset.encode().unwrap()).unwrap().levels.remove(0);
    let mean = |lobes: &[FlakeLobe]| lobes.iter().map(|lobe| f64::from(lobe.albedo[1])).sum::<f64>() / 512.0;
    let off = (mean(&found.lobes[0]) - mean(&asset.levels[0].lobes[0])).abs();
    assert!(off <= 0.5 / 255.0 / 512.0 + 1e-7, "the mean is off by {off}");
}

#[test]
fn a_decoded_volume_written_again_evaluates_the_same() {
    let once = decode(&Sample::ROOMY.asset().encode().unwrap()).unwrap();
    let twice = decode(&once.encode().unwrap()).unwrap();
    let mut random = Random(5);
    assert_eq!(once.levels[0].occupied, twice.levels[0].occupied);
    for voxel in 0..once.levels[0].occupied.len() {
        let [a, b] = [&once, &twice].map(|asset| asset.levels[0].voxel(voxel));
        let w = direction(&mut random);
        // One more rounding of the density; a lobe of at most 0.03 along its fibre may lose a code.
        assert!((a.extinction(w) - b.extinction(w)).abs() <= 0.004 * a.density, "{a:?} {b:?}");
    }
}

#[test]
fn the_first_version_still_decodes() {
    // Written by `sample_volumes` when volumes were new; only these bytes, not the writer, are promised to stay.
    let asset = VolumeAsset::read(std::path::Path::new("tests/data/volume_v1")).unwrap();
    assert_eq!(asset, decode(&Sample::ROOMY.asset().encode().unwrap()).unwrap());
    assert_eq!(VolumeAsset::files(std::path::Path::new("tests/data/volume_v1")).unwrap().len(), 8);
}

#[test]
fn the_same_volume_gives_the_same_bytes() {
    for sample in variants() {
        assert_eq!(sample.asset().encode().unwrap(), sample.asset().encode().unwrap());
    }
}

#[test]
fn payloads_of_volumes_are_ktx2_files_to_the_ktx2_crate() {
    let files = Sample::ROOMY.asset().encode().unwrap();
    for (name, bytes) in files.iter().filter(|(name, _)| *name != DOCUMENT) {
        let reader = ktx2::Reader::new(bytes).unwrap();
        let header = reader.header();
        let format = header.format.unwrap();
        let role = name.split('.').nth(1).unwrap().trim_end_matches(|c: char| c.is_ascii_digit());
        let wanted = match role {
            "bricks" => ktx2::Format::R32_UINT,
            "density" => ktx2::Format::R16_SFLOAT,
            "shear" => ktx2::Format::R8_UNORM,
            _ => ktx2::Format::R8G8B8A8_UNORM,
        };
        assert_eq!(format, wanted);
        let (descriptor, type_size) = ktx2::dfd::Basic::from_format(format).unwrap();
        assert_eq!(reader.basic_dfd(), Some(&descriptor), "{role}");
        assert_eq!(header.type_size, type_size);
        let size = [header.pixel_width, header.pixel_height, header.pixel_depth];
        // 5 × 3 × 3 bricks, of which 2 × 2 × 3 less their first layer in each of two axes are left out.
        assert_eq!(
            if role == "bricks" { size } else { size.map(|n| n / 8) },
            if role == "bricks" { [5, 3, 3] } else { [4, 3, 3] }
        );
    }
}

#[test]
fn voxels_are_found_by_place() {
    let asset = Sample::ROOMY.asset();
    let level = &asset.levels[0];
    let [nx, ny, nz] = level.size;
    for voxel in 0..nx * ny * nz {
        let place = [voxel % nx, voxel / nx % ny, voxel / nx / ny];
        let x = std::array::from_fn(|axis| (place[axis] as f32 + 0.5) / level.size[axis] as f32);
        let found = level.voxel_at(x).map(|voxel| voxel.density);
        let wanted = level.occupied.iter().position(|&index| index as usize == voxel).map(|at| level.density[at]);
        assert_eq!(found, wanted);
    }
    assert!(level.voxel_at([0.999_999_99; 3]).is_none(), "the far corner is empty");
}

/// Relative error of Σ φ_j σ_j over directions: root mean square, worst, mean; `pack` gives what comes back.
fn area_errors(along: f32, count: usize, pack: impl Fn(&[FlakeLobe]) -> (f32, Vec<FlakeLobe>)) -> [f64; 3] {
    let mut random = Random(11);
    let (mut squares, mut worst, mut sum, mut number) = (0.0, 0.0f64, 0.0, 0.0);
    for _ in 0..2000 {
        let albedo = [1.0; 3];
        let mut lobe = |area| FlakeLobe { area, shape: Sggx::fibre(direction(&mut random), along), albedo };
        let lobes: Vec<FlakeLobe> = if count == 1 { vec![lobe(1.0)] } else { vec![lobe(0.3), lobe(0.7)] };
        let (density, packed) = pack(&lobes);
        for _ in 0..50 {
            let w = direction(&mut random);
            let was = f64::from(sggx::projected_area(&lobes, w));
            let error = f64::from(density) * f64::from(sggx::projected_area(&packed, w)) / was - 1.0;
            squares += error * error;
            sum += error;
            worst = worst.max(error.abs());
            number += 1.0;
        }
    }
    [f64::sqrt(squares / number), worst, sum / number]
}

#[test]
fn rounding_changes_the_area_that_flakes_show_by_less_than_half_a_percent() {
    let ours = |lobes: &[FlakeLobe]| quantised_voxel(1.0, lobes).unwrap();
    for (along, count, rms, worst) in
        [(1.0, 1, 0.002, 0.006), (0.3, 1, 0.002, 0.02), (0.1, 1, 0.003, 0.06), (0.1, 2, 0.003, 0.03)]
    {
        let found = area_errors(along, count, ours);
        println!("along {along}, {count} lobes: RMS {:.4}, worst {:.4}, mean {:.6}", found[0], found[1], found[2]);
        assert!(found[0] < rms && found[1] < worst, "{along}: {found:?}");
        // The density makes up for the mean: what is left is far below the 0.2 % that an image may change.
        assert!(found[2].abs() < 2e-4, "{along}: {found:?}");
    }
}

/// S as standard deviations and correlations of 8 bits each: the packing that comes with SGGX.
fn by_correlations(lobes: &[FlakeLobe]) -> (f32, Vec<FlakeLobe>) {
    let rounded = lobes.iter().map(|lobe| {
        let [xx, yy, zz, xy, xz, yz] = lobe.shape.matrix();
        let [x, y, z] = [xx, yy, zz].map(|variance| (variance.sqrt() * 255.0).round() / 255.0);
        let pairs = [(xy, xx * yy, x * y), (xz, xx * zz, x * z), (yz, yy * zz, y * z)];
        let [xy, xz, yz] = pairs.map(|(s, product, rounded)| (s / product.sqrt() * 127.0).round() / 127.0 * rounded);
        // A reader would clamp what rounding made negative.
        let shape = Sggx::from_matrix([x * x, y * y, z * z, xy, xz, yz]);
        let lifted = || Sggx::from_matrix([x * x + 0.02, y * y + 0.02, z * z + 0.02, xy, xz, yz]);
        FlakeLobe { shape: shape.or_else(lifted).unwrap_or(Sggx::ISOTROPIC), ..*lobe }
    });
    (1.0, rounded.collect())
}

#[test]
fn roots_of_s_lose_less_than_correlations_do() {
    for along in [0.03, 0.1, 0.3] {
        let ours = area_errors(along, 1, |lobes| quantised_voxel(1.0, lobes).unwrap());
        let theirs = area_errors(along, 1, by_correlations);
        println!(
            "along {along}: RMS {:.4} against {:.4}, worst {:.3} against {:.3}",
            ours[0], theirs[0], ours[1], theirs[1]
        );
        assert!(ours[0] < theirs[0] && ours[1] < theirs[1], "{along}: {ours:?} {theirs:?}");
    }
}

#[test]
fn phase_functions_of_rounded_lobes_carry_their_albedo() {
    let asset = decode(&Sample { albedo: Some([1.0, 0.5, 0.25]), ..Sample::SMALL }.asset().encode().unwrap()).unwrap();
    let n = 240;
    let solid_angle = 4.0 * std::f64::consts::PI / (2 * n * n) as f64;
    let mut random = Random(3);
    for voxel in (0..asset.levels[0].occupied.len()).step_by(5).map(|place| asset.levels[0].voxel(place)) {
        let w = direction(&mut random);
        // Half vectors over the sphere instead of directions: dω′ = 4 |ω·h| dh, so narrow lobes cost no more points.
        let mut albedo = [0.0; 3];
        for k in 0..2 * n * n {
            let [i, j] = [k % n, k / n % n].map(|i| (i as f32 + 0.5) / n as f32);
            let [x, y, z] = farfield_formats::lookup::direction_of([i, j]);
            let h = if k < n * n { [x, y, z] } else { [x, y, -z] };
            let cosine: f32 = (0..3).map(|c| w[c] * h[c]).sum();
            if cosine > 0.0 {
                let wi: [f32; 3] = std::array::from_fn(|c| 2.0 * cosine * h[c] - w[c]);
                let p = voxel.phase(w, wi);
                (0..3).for_each(|c| albedo[c] += f64::from(p[c] * 4.0 * cosine) * solid_angle);
            }
        }
        for (found, wanted) in albedo.into_iter().zip([1.0, 0.5, 0.25]) {
            // The midpoint rule over lobes down to 0.03 wide.
            assert!((found / wanted - 1.0).abs() < 0.01, "{albedo:?} {voxel:?}");
        }
    }
}
