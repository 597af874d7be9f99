//! A flat plane must come out as it went in: T = 1 and f_low = f, read through the asset's own bytes.

mod support;

use std::sync::LazyLock;

use farfield::geometry::Boundary;
use farfield::material::Brdf;
use farfield::math::rng::Stream;
use farfield::prefilter::surface::FineSurface;
use formats::asset::SurfaceAsset;
use glam::Vec3;
use support::{COS_75, at, both, compiled, diffuse, field, ggx, random_direction, through_bytes};

/// The bases, and how far f_low may be off between the nodes: 5 % is the bound of f_c itself.
fn bases() -> Vec<(String, Brdf, f64)> {
    let conductors = [0.02, 0.1, 0.3, 1.0].map(|alpha| (format!("GGX {alpha}"), ggx(alpha), 0.05));
    let mut bases = vec![("diffuse".to_string(), diffuse(0.5), 0.002)];
    bases.extend(conductors);
    bases.push(("diffuse + GGX 0.3".into(), both(0.3), 0.05));
    bases
}

fn plane(brdf: Brdf, boundary: Boundary) -> (FineSurface, SurfaceAsset) {
    let fine = FineSurface { heights: field([64, 48], [0.5, 0.7], boundary, |_, _| 0.3), brdf, color: None };
    let coarse = compiled(&fine, &at(8.0));
    assert!(coarse.warnings.is_empty(), "{:?}", coarse.warnings);
    let asset = through_bytes(&fine, coarse);
    (fine, asset)
}

/// Every base on a plane that tiles: name, bound between the nodes, surface and asset.
static PLANES: LazyLock<Vec<(String, f64, FineSurface, SurfaceAsset)>> = LazyLock::new(|| {
    let compile = |(name, brdf, bound)| {
        let (fine, asset) = plane(brdf, Boundary::Repeat);
        (name, bound, fine, asset)
    };
    bases().into_iter().map(compile).collect()
});

/// f_low over f − 1 in green at a pair of directions.
fn deviation(fine: &FineSurface, asset: &SurfaceAsset, x: [f32; 2], [wi, wo]: [Vec3; 2]) -> f64 {
    let level = &asset.levels[0];
    let n_c = level.normal_at(asset, x);
    let low = level.f_low(asset, x, n_c, wi.to_array(), wo.to_array());
    let f = fine.brdf.eval(Vec3::Z, wi, wo);
    f64::from(low[1]) / f64::from(f[1]) - 1.0
}

#[test]
fn the_scaling_over_the_plane_is_one_and_its_heights_are_kept() {
    let (fine, finite) = plane(both(0.3), Boundary::Clamp);
    let finite = ("finite".to_string(), 0.0, fine, finite);
    for (name, _, _, asset) in PLANES.iter().chain([&finite]) {
        let level = &asset.levels[0];
        assert!(level.spatial.iter().flatten().flatten().all(|&t| t == 1.0), "{name}: {:?}", level.spatial);
        assert!(level.heights.iter().all(|&h| (h - 0.3).abs() < 1e-6), "{name}");
        assert_eq!(level.cells, [8, 6]);
        assert_eq!(level.lobes.len(), 1, "{name}: a plane needs one lobe");
    }
}

#[test]
fn a_plane_is_its_base_brdf_at_the_nodes() {
    let mut missed = Vec::new();
    for (name, _, fine, asset) in PLANES.iter() {
        let directions: Vec<Vec3> = formats::lookup::direction_grid(15).into_iter().map(Vec3::from).collect();
        let mut worst = (0.0_f64, [Vec3::Z; 2]);
        let mut worst_below = (0.0_f64, [Vec3::Z; 2]);
        for (i, &wi) in directions.iter().enumerate() {
            for &wo in &directions[..=i] {
                let off = deviation(fine, asset, [0.3, 0.7], [wi, wo]).abs();
                if off > worst.0 {
                    worst = (off, [wi, wo]);
                }
                if off > worst_below.0 && wi.z > COS_75 && wo.z > COS_75 {
                    worst_below = (off, [wi, wo]);
                }
            }
        }
        println!("{name}: worst node {:.3} %, below 75° {:.3} %", 100.0 * worst.0, 100.0 * worst_below.0);
        if worst.0 >= 0.002 {
            missed.push((name, worst, worst_below));
        }
    }
    assert!(missed.is_empty(), "more than 0.2 % off at a node: {missed:?}");
}

#[test]
fn a_plane_is_its_base_brdf_between_the_nodes() {
    let mut missed = Vec::new();
    for (name, bound, fine, asset) in PLANES.iter() {
        let rng = Stream::new(31, 0);
        let (mut worst, mut square, mut total, mut count) = (0.0_f64, 0.0, 0.0, 0);
        for k in 0..40_000 {
            let [wi, wo] = [0, 1].map(|d| random_direction(rng, 3 * k + d));
            if wi.z < COS_75 || wo.z < COS_75 {
                continue;
            }
            let off = deviation(fine, asset, rng.uniform_pair(3 * k + 2), [wi, wo]);
            let f = f64::from(fine.brdf.eval(Vec3::Z, wi, wo)[1] * wi.z * wo.z);
            worst = worst.max(off.abs());
            square += (off * f).powi(2);
            total += f * f;
            count += 1;
        }
        let error = (square / total).sqrt();
        println!("{name}: {count} pairs, worst {:.2} %, error {:.2} %", 100.0 * worst, 100.0 * error);
        if worst >= *bound {
            missed.push((name, worst, bound));
        }
    }
    assert!(missed.is_empty(), "too far off between the nodes: {missed:?}");
}
