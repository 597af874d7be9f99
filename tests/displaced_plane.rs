//! Rays against tiled height fields, alone and on a large shape, against what cannot be wrong: the heights themselves.

use farfield::geometry::{Boundary, DisplacedPlane, HeightField, HeightTracer, LargeShape, PlaneHit, Ray};
use farfield::math::rng::Stream;
use glam::{DVec3, Vec3};

/// A tile of 16 × 16 random heights, 1 m a texel.
fn tile() -> HeightField {
    let stream = Stream::new(5, 1);
    let heights = (0..256).map(|k| 2.0 * stream.uniform(k)).collect();
    HeightField::new(heights, [16, 16], [1.0, 1.0], Boundary::Repeat)
}

/// A rough shape of 12 × 10 cells over 6 × 4 tiles.
fn large() -> LargeShape {
    let stream = Stream::new(6, 1);
    let heights = (0..120).map(|k| 10.0 * stream.uniform(k)).collect();
    LargeShape::new(HeightField::new(heights, [12, 10], [8.0, 6.4], Boundary::Clamp))
}

const TILES: [u32; 2] = [6, 4];

/// Height of the sum at (x, y), by its definition.
fn height(tile: &HeightField, large: Option<&LargeShape>, x: f64, y: f64) -> f64 {
    let place = [x.rem_euclid(16.0), (-y).rem_euclid(16.0)];
    let [i, j] = place.map(|p| (p as usize).min(15));
    let [s, t] = [place[0] - i as f64, place[1] - j as f64];
    let [h00, h10, h01, h11] = tile.corners(i, j).map(f64::from);
    let detail = (h00 * (1.0 - s) + h10 * s) * (1.0 - t) + (h01 * (1.0 - s) + h11 * s) * t;
    let shape = large.map_or(0.0, |large| {
        let facet = large.facet_at(x, y);
        facet.height + facet.tilt.x * x + facet.tilt.y * y
    });
    detail + shape
}

/// A random ray from above, or from within the range of heights if `inside`.
fn random_ray(stream: Stream, k: u64) -> Ray {
    let [a, b] = stream.uniform_pair(2 * k);
    let [c, d] = stream.uniform_pair(2 * k + 1);
    let z = -f64::from(c).max(0.01);
    let phi = f64::from(d) * std::f64::consts::TAU;
    let sin = (1.0 - z * z).sqrt();
    let direction = DVec3::new(sin * phi.cos(), sin * phi.sin(), z).as_vec3();
    // aimed at a point inside, from well above
    let target = DVec3::new(8.0 + 80.0 * f64::from(a), -8.0 - 48.0 * f64::from(b), 1.0);
    Ray { origin: target - 30.0 * direction.as_dvec3(), direction }
}

/// The normal of the sum by central differences of its height, for points well inside of a cell.
fn check_hit(tile: &HeightField, large: Option<&LargeShape>, ray: &Ray, hit: &PlaneHit) {
    let at = ray.origin + hit.t * ray.direction.as_dvec3();
    if at.x.min(-at.y).min(96.0 - at.x).min(64.0 + at.y) < 1e-9 {
        return; // the cut at the rim
    }
    assert!((at - hit.position).length() < 1e-6, "{hit:?}"); // fractions of a cell are f32
    let z = height(tile, large, at.x, at.y);
    assert!((z - at.z).abs() < 1e-5, "surface at {z}, hit at {at}: {ray:?} {hit:?}");
    // nothing before it
    let steps = 4000;
    for k in 0..steps {
        let p = ray.origin + hit.t * (f64::from(k) / f64::from(steps)) * ray.direction.as_dvec3();
        let covered = (0.0..=96.0).contains(&p.x) && (-64.0..=0.0).contains(&p.y);
        assert!(!covered || p.z > height(tile, large, p.x, p.y) - 1e-6, "passes through at {p}: {ray:?} {hit:?}");
    }
}

#[test]
fn hits_lie_on_the_sum_of_tile_and_large_shape_and_nothing_lies_before_them() {
    let (tile, large) = (tile(), large());
    for large in [None, Some(&large)] {
        let plane = DisplacedPlane::new(HeightTracer::new(&tile), TILES, large);
        let stream = Stream::new(1, 2);
        let mut hits = 0;
        for k in 0..2000 {
            let ray = random_ray(stream, k);
            if !plane.is_outside(ray.origin) {
                continue;
            }
            let Some(hit) = plane.intersect(&ray) else { continue };
            hits += 1;
            check_hit(&tile, large, &ray, &hit);
        }
        assert!(hits > 1500, "{hits}");
    }
}

#[test]
fn bounces_meet_what_a_ray_from_the_same_place_meets() {
    let (tile, large) = (tile(), large());
    for large in [None, Some(&large)] {
        let plane = DisplacedPlane::new(HeightTracer::new(&tile), TILES, large);
        let [from, to] = [Stream::new(1, 2), Stream::new(1, 3)];
        let [mut hits, mut misses] = [0; 2];
        for k in 0..4000 {
            let ray = random_ray(from, k);
            let Some(start) = plane.intersect(&ray).filter(|_| plane.is_outside(ray.origin)) else { continue };
            let direction = -random_ray(to, k).direction;
            if start.normal.dot(direction) < 0.02 {
                continue;
            }
            let again = plane.intersect_from(&start, direction);
            assert_eq!(again.is_some(), plane.occluded(&start, direction, f64::INFINITY), "{start:?} {direction}");
            // the start's fraction of a cell is f32, so the ray starts up to 1e-7 away from the hit
            let lifted = Ray { origin: start.position + 1e-5 * start.normal.as_dvec3(), direction };
            let expected = plane.intersect(&lifted);
            match (again, expected) {
                (Some(a), Some(b)) if (a.t - b.t).abs() < 1e-2 => {
                    check_hit(&tile, large, &Ray { origin: start.position, direction }, &a);
                    assert!(plane.occluded(&start, direction, a.t * 1.001 + 1e-6));
                    assert!(!plane.occluded(&start, direction, a.t * 0.999 - 1e-6));
                    hits += 1;
                }
                (None, None) => misses += 1,
                // grazing a crest, the lifted ray passes where the exact one does not
                _ => {}
            }
        }
        assert!(hits > 300 && misses > 400 && hits + misses > 1500, "{hits} hits, {misses} misses");
    }
}

#[test]
fn no_ray_slips_through_seams_of_cells_tiles_and_facets() {
    let (tile, large) = (tile(), large());
    let diagonal = 0.5_f32.sqrt();
    let across = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [diagonal, diagonal], [-diagonal, diagonal]];
    for large in [None, Some(&large)] {
        let plane = DisplacedPlane::new(HeightTracer::new(&tile), TILES, large);
        for [x, y] in across {
            for z in [-0.05, -0.5, -3.0] {
                let direction = Vec3::new(x, y, z).normalize();
                for k in 0..400 {
                    // on borders of cells, tiles and facets: multiples of 0.8 and 1.6 meet those of the large cells
                    let target = DVec3::new(16.0 + 1.6 * f64::from(k % 20), -16.0 - 1.6 * f64::from(k / 20), 6.0);
                    let ray = Ray {
                        origin: target - 6.0 * direction.as_dvec3() / f64::from(-direction.z).max(0.3),
                        direction,
                    };
                    if !plane.is_outside(ray.origin) {
                        continue;
                    }
                    let hit = plane.intersect(&ray);
                    // a flat ray may leave over the rim
                    let over_rim = 30.0 * f64::from(direction.z) / f64::from(direction.x.hypot(direction.y)) > -14.0;
                    assert!(hit.is_some() || over_rim, "{ray:?}");
                    if let Some(hit) = hit {
                        check_hit(&tile, large, &ray, &hit);
                    }
                }
            }
        }
        for k in 0..2000 {
            let origin = DVec3::new(0.8 * f64::from(k % 120), -0.8 * f64::from(k / 120), 100.0);
            assert!(plane.intersect(&Ray { origin, direction: Vec3::NEG_Z }).is_some(), "{origin}");
        }
    }
}

#[test]
fn the_plane_is_solid_underneath_and_ends_at_its_rim() {
    let (tile, large) = (tile(), large());
    for large in [None, Some(&large)] {
        let plane = DisplacedPlane::new(HeightTracer::new(&tile), TILES, large);
        let below = Ray { origin: DVec3::new(30.0, -30.0, -5.0), direction: Vec3::new(0.1, 0.1, 1.0).normalize() };
        let hit = plane.intersect(&below).expect("the underside stops a ray");
        assert!(hit.normal.dot(below.direction) > 0.0, "seen from behind");
        for origin in [DVec3::new(-1.0, -30.0, 50.0), DVec3::new(97.0, -30.0, 50.0), DVec3::new(30.0, 1.0, 50.0)] {
            assert!(plane.intersect(&Ray { origin, direction: Vec3::NEG_Z }).is_none(), "beside the plane");
        }
        assert!(plane.is_outside(DVec3::new(-1.0, -30.0, -2.0)));
        for (x, y) in [(3.3, -4.4), (50.2, -20.7), (90.1, -60.6)] {
            let z = height(&tile, large, x, y);
            assert!(plane.is_outside(DVec3::new(x, y, z + 1e-3)));
            assert!(!plane.is_outside(DVec3::new(x, y, z - 1e-3)));
        }
    }
}

#[test]
fn two_hundred_thousand_texels_a_side_are_as_precise_and_as_small_as_one_tile() {
    let tile = tile();
    let near = DisplacedPlane::new(HeightTracer::new(&tile), [1, 1], None);
    let far = DisplacedPlane::new(HeightTracer::new(&tile), [12_500, 12_500], None);
    assert_eq!(near.tile().bytes(), far.tile().bytes());
    let offset = DVec3::new(199_984.0, -199_984.0, 0.0);
    let stream = Stream::new(1, 9);
    for k in 0..2000 {
        let [a, b] = stream.uniform_pair(2 * k);
        let [c, d] = stream.uniform_pair(2 * k + 1);
        let origin = DVec3::new(8.0 + f64::from(a), -8.0 - f64::from(b), 4.0);
        let direction = Vec3::new(c - 0.5, d - 0.5, -1.0).normalize();
        let hit = near.intersect(&Ray { origin, direction }).unwrap();
        let distant = far.intersect(&Ray { origin: origin + offset, direction }).unwrap();
        // a ray enters its first cell at a fraction in f32: 6e-8 of a texel, over slopes of up to 3
        assert!((hit.t - distant.t).abs() < 1e-6, "{hit:?} {distant:?}");
    }
}
