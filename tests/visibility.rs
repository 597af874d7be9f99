//! Visibility bits against exact ray casts from the texels' centres.

mod support;

use farfield::geometry::{Boundary, HeightField, HeightTracer};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::reflectance::TableDirections;
use farfield::prefilter::surface::visibility::{EMPTY_SLOT, Orientation, ShadowSweep, VisibilityBits};
use glam::Vec3;
use support::{FIXTURES, centre, crop, field, fixture, towards, waves};

/// Upper polar angles of the bands that mismatches are counted in, degrees.
const BANDS: [f32; 4] = [45.0, 65.0, 75.0, 90.0];

/// Wrong bits and bits looked at, a band. A wrong bit is of a texel that the exact cast finds lit, hidden by others, or
/// averted: the last kind is harmless, for an averted texel shows no area and its bit is multiplied by 0.
#[derive(Clone, Copy, Debug, Default)]
struct Mismatch {
    wrong: [[u64; 3]; 4],
    count: [u64; 4],
}

impl Mismatch {
    /// Wrong bits of the given kinds over all bits of the bands.
    fn share(&self, bands: std::ops::Range<usize>, kinds: std::ops::Range<usize>) -> f64 {
        let wrong: u64 = self.wrong[bands.clone()].iter().flat_map(|wrong| &wrong[kinds.clone()]).sum();
        wrong as f64 / self.count[bands].iter().sum::<u64>().max(1) as f64
    }

    /// Wrong bits that matter, below 75°.
    fn below_75(&self) -> f64 {
        self.share(0..3, 0..2)
    }

    fn row(&self) -> String {
        let percent = |share: f64| format!("{:6.3} %", 100.0 * share);
        let bands: Vec<String> = (0..4).map(|band| percent(self.share(band..band + 1, 0..2))).collect();
        let kinds: Vec<String> = (0..3).map(|kind| percent(self.share(0..3, kind..kind + 1))).collect();
        format!("{} | {} | {}", bands.join(" "), percent(self.below_75()), kinds.join(" "))
    }
}

/// The head of a table of [`Mismatch::row`].
fn head(width: usize) -> String {
    format!("{:width$}  0–45°   45–65°   65–75°    above | below 75 | lit     hidden    averted", "map")
}
/// All texels in row-major order, padded to whole words.
fn slots(texels: usize) -> Vec<u32> {
    (0..texels.next_multiple_of(64)).map(|t| if t < texels { t as u32 } else { EMPTY_SLOT }).collect()
}

/// Compares the bits of `field` with exact casts at `samples` random texels for every direction; all texels if fewer.
fn compare(field: &HeightField, directions: &[[f32; 3]], samples: usize) -> Mismatch {
    let [width, height] = field.size();
    let bits = VisibilityBits::sweep(field, directions, slots(width * height));
    let tracer = HeightTracer::new(field);
    let mut mismatch = Mismatch::default();
    for (d, &w) in directions.iter().enumerate() {
        let band = BANDS.iter().position(|limit| w[2] > limit.to_radians().cos() || *limit == 90.0).unwrap();
        let rng = Stream::new(5, d as u64);
        for k in 0..samples.min(width * height) {
            let texel = if samples < width * height { rng.u32(k as u64) as usize % (width * height) } else { k };
            let seen = (bits.direction(d)[texel / 64] >> (texel % 64)) & 1 == 1;
            let point = centre(texel % width, texel / width);
            let faces = tracer.normal(point).dot(Vec3::from(w)) > 0.0;
            let lit = faces && !tracer.occluded(point, Vec3::from(w));
            let kind = if lit { 0 } else { 2 - usize::from(faces) };
            mismatch.wrong[band][kind] += u64::from(seen != lit);
            mismatch.count[band] += 1;
        }
    }
    mismatch
}

/// The bar: wrong bits below 75°.
const BAR: f64 = 0.003;

#[test]
fn bits_of_the_fixtures_agree_with_ray_casts() {
    let directions = TableDirections::new(15);
    println!("{}", head(16));
    let mut missed = Vec::new();
    for (name, amplitude) in FIXTURES {
        let map = fixture(name, amplitude);
        let mismatch = compare(&map, &directions.vectors, 1500);
        println!("{name:16}{}", mismatch.row());
        // walls of 80:1 are the one map whose occluders are a texel wide
        let bar = if name == "heights/cliffs" { f64::INFINITY } else { BAR };
        if mismatch.below_75() > bar {
            missed.push(name);
        }
    }
    assert!(missed.is_empty(), "more than 0.3 % of the bits below 75° are wrong: {missed:?}");
}

#[test]
fn bits_of_finite_oblong_and_stretched_maps_agree_with_ray_casts() {
    let directions = TableDirections::new(15);
    let twill = fixture("heights/twill", 24.415);
    let bump = fixture("heights/bump", 28.0);
    let cases = [
        ("twill, clamp, 200 × 131", crop(&twill, [200, 131], [1.0; 2], Boundary::Clamp)),
        ("twill, repeat, 200 × 131", crop(&twill, [200, 131], [1.0; 2], Boundary::Repeat)),
        ("bump, clamp, 77 × 256", crop(&bump, [77, 256], [1.0; 2], Boundary::Clamp)),
        ("twill, texels 1 × 2.5", crop(&twill, [256, 128], [1.0, 2.5], Boundary::Clamp)),
        ("twill, texels 2.5 × 1", crop(&twill, [128, 256], [2.5, 1.0], Boundary::Repeat)),
        ("twill in millimetres", { field([256, 256], [1e-3; 2], Boundary::Clamp, |i, j| 1e-3 * twill.vertex(i, j)) }),
        ("waves, repeat, 96 × 160", field([96, 160], [1.0; 2], Boundary::Repeat, waves([96, 160], 16.0, 6.0, 3))),
    ];
    println!("{}", head(26));
    let mut missed = Vec::new();
    for (name, map) in &cases {
        let mismatch = compare(map, &directions.vectors, 3000);
        println!("{name:26}{}", mismatch.row());
        if mismatch.below_75() > BAR {
            missed.push(*name);
        }
    }
    assert!(missed.is_empty(), "more than 0.3 % of the bits below 75° are wrong: {missed:?}");
}

#[test]
fn bits_of_one_row_or_one_column_agree_with_ray_casts() {
    let directions = TableDirections::new(15);
    let mut missed = Vec::new();
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for size in [[1, 700], [700, 1]] {
            let height = waves(size, 12.0, 4.0, 9);
            let mismatch = compare(&field(size, [1.0; 2], boundary, height), &directions.vectors, usize::MAX);
            println!("{size:?} {boundary:?}: {}", mismatch.row());
            // all texels of a finite strip one texel wide lie at the rim, where rays leave within half a texel
            let bar = if boundary == Boundary::Clamp { 0.025 } else { BAR };
            if mismatch.below_75() > bar {
                missed.push((size, boundary));
            }
        }
    }
    assert!(missed.is_empty(), "more than 0.3 % of the bits below 75° are wrong: {missed:?}");
}

#[test]
fn every_texel_of_a_flat_map_sees_every_direction() {
    let mut directions = TableDirections::new(15).vectors;
    directions.extend((0..16).map(|k| towards(89.9_f32.to_radians(), k as f32 * 0.4).to_array()));
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for (size, spacing) in
            [([64, 48], [1.0, 1.0]), ([1, 33], [1.0, 2.5]), ([33, 1], [1e-3, 1e-3]), ([1, 1], [1.0; 2])]
        {
            for height in [0.0, 0.7, -3.3, 1e3] {
                let texels = size[0] * size[1];
                let flat = field(size, spacing, boundary, |_, _| height);
                let bits = VisibilityBits::sweep(&flat, &directions, slots(texels));
                for (d, w) in directions.iter().enumerate() {
                    let seen: u32 = bits.direction(d).iter().map(|word| word.count_ones()).sum();
                    assert_eq!(seen as usize, texels, "{size:?} {boundary:?} at {height} m towards {w:?}");
                }
            }
        }
    }
}

#[test]
fn a_wall_throws_the_shadow_that_its_height_says() {
    // A wall 8 m high that fills column 40; light from +x at elevation atan(½) shadows 16 m on its −x side.
    let wall = |i: usize, _| if i == 40 { 8.0 } else { 0.0 };
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        let map = field([64, 5], [1.0; 2], boundary, wall);
        for (sign, shadowed) in [(1.0, 24..40), (-1.0, 41..56)] {
            let w = Vec3::new(2.0 * sign, 0.0, 1.0).normalize();
            let mut mask = vec![0; 64 * 5];
            let order = ShadowSweep::new(&map).mask(w.to_array(), &mut mask);
            for i in (0..64).filter(|i| ![39, 40].contains(i)) {
                for j in 0..5 {
                    let at = if order == Orientation::RowMajor { j * 64 + i } else { i * 5 + j };
                    // the centre at i + ½ is hidden if it lies within 16 m of the crest at column 40
                    assert_eq!(mask[at] == 0, shadowed.contains(&i), "column {i}, light from {sign}, {boundary:?}");
                }
            }
        }
    }
}

#[test]
fn the_shadow_of_a_repeated_map_wraps_and_that_of_a_finite_one_ends() {
    // One bar at the right end, light from the left at a slope of 1: the shadow falls past the rim.
    let bar = |i: usize, _| if i == 60 { 10.0 } else { 0.0 };
    let w = Vec3::new(-1.0, 0.0, 1.0).normalize();
    for (boundary, expected) in [(Boundary::Repeat, 1), (Boundary::Clamp, 0)] {
        let map = field([64, 4], [1.0; 2], boundary, bar);
        let bits = VisibilityBits::sweep(&map, &[w.to_array()], slots(256));
        // texels 0 to 5 of the next period lie within 10 m of the bar's crest
        let hidden = |i: usize| 1 - ((bits.direction(0)[i / 64] >> (i % 64)) & 1);
        (0..5).for_each(|i| assert_eq!(hidden(i), expected, "texel {i}, {boundary:?}"));
        assert_eq!(hidden(8), 0, "{boundary:?}");
        assert_eq!(hidden(62), 1, "{boundary:?}");
    }
}
