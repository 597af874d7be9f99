//! Lobes of whole levels: what they must keep, and the hard cases.

use farfield::geometry::{Boundary, HeightField};
use farfield::math::vmf::{MAX_KAPPA, mean_resultant_length};
use farfield::prefilter::surface::VmfLobe;
use farfield::prefilter::surface::downsample::coarse_cells;
use farfield::prefilter::surface::lobes::{MAX_LOBES, choose_lobe_count, fit_lobes};

/// A map of fixtures/heights, lengths in texels.
fn fixture(name: &str, amplitude: f32) -> HeightField {
    let path = format!("{}/fixtures/heights/{name}.png", env!("CARGO_MANIFEST_DIR"));
    let map = image::open(path).unwrap().into_luma16();
    let size = [map.width() as usize, map.height() as usize];
    let heights = map.into_raw().iter().map(|&code| f32::from(code) / 65535.0 * amplitude).collect();
    HeightField::new(heights, size, [1.0, 1.0], Boundary::Repeat)
}

fn field(size: [usize; 2], boundary: Boundary, height: impl Fn(usize, usize) -> f32) -> HeightField {
    let heights = (0..size[0] * size[1]).map(|k| height(k % size[0], k / size[0])).collect();
    HeightField::new(heights, size, [1.0, 1.0], boundary)
}

fn rough(size: [usize; 2], amplitude: f32, boundary: Boundary) -> HeightField {
    let hash = |k: usize| ((k as u32).wrapping_mul(2_654_435_761).wrapping_add(12_345) >> 8) as f32 / (1 << 24) as f32;
    field(size, boundary, |i, j| amplitude * hash(j * size[0] + i))
}

/// ∫ω D dω of a cell: z is its projected area, x and y are minus its mean slopes.
fn mean_normal(lobes: &[Vec<VmfLobe>], cell: usize) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for lobe in lobes.iter().map(|level| &level[cell]) {
        let scale = f64::from(lobe.weight) * f64::from(mean_resultant_length(lobe.kappa));
        sum.iter_mut().zip(lobe.mean).for_each(|(sum, m)| *sum += scale * f64::from(m));
    }
    sum
}

/// What holds for every cell of every level.
fn expect_sound(lobes: &[Vec<VmfLobe>], cells: usize, what: &str) {
    for cell in 0..cells {
        let z = mean_normal(lobes, cell)[2];
        assert!((z - 1.0).abs() < 1e-6, "{what}: cell {cell} shows {z}");
        let mut last = f32::INFINITY;
        for lobe in lobes.iter().map(|level| &level[cell]) {
            let length = lobe.mean.iter().map(|m| m * m).sum::<f32>().sqrt();
            assert!((length - 1.0).abs() < 1e-6, "{what}: mean direction of length {length}");
            assert!((0.0..=MAX_KAPPA).contains(&lobe.kappa), "{what}: kappa {}", lobe.kappa);
            assert!((0.0..=last).contains(&lobe.weight), "{what}: weight {} after {last}", lobe.weight);
            last = lobe.weight;
        }
        let area: f32 = lobes.iter().map(|level| level[cell].weight).sum();
        assert!(area > 1.0 - 1e-6, "{what}: less micro-area than base area, {area}");
    }
}

#[test]
fn every_cell_keeps_its_projected_area() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for (size, factor) in [([64, 48], 8.0), ([33, 70], 3.7), ([1, 90], 8.0), ([90, 1], 8.0), ([16, 16], 100.0)] {
            for amplitude in [0.0, 1e-9, 0.1, 3.0, 1e3] {
                let fine = rough(size, amplitude, boundary);
                let cells = coarse_cells(size, factor);
                for count in [1, 3, 8] {
                    let lobes = fit_lobes(&fine, cells, Some(count));
                    assert_eq!(lobes.len(), count);
                    expect_sound(&lobes, cells[0] * cells[1], &format!("{boundary:?} {size:?} {amplitude} {count}"));
                }
            }
        }
    }
}

#[test]
fn every_cell_keeps_its_mean_slope() {
    let fine = rough([64, 64], 4.0, Boundary::Repeat);
    let lobes = fit_lobes(&fine, [8, 8], Some(4));
    for cell in 0..64 {
        let [ci, cj] = [cell % 8 * 8, cell / 8 * 8];
        let [mut slope_x, mut slope_y] = [0.0, 0.0];
        for k in 0..64 {
            let slope = fine.slope(ci + k % 8, cj + k / 8, 0.5, 0.5);
            slope_x += f64::from(slope[0]) / 64.0;
            slope_y += f64::from(slope[1]) / 64.0;
        }
        let [x, y, _] = mean_normal(&lobes, cell);
        assert!((x + slope_x).abs() < 5e-6 && (y + slope_y).abs() < 5e-6, "cell {cell}: {x} {slope_x}, {y} {slope_y}");
    }
}

#[test]
fn hard_maps_give_sound_lobes() {
    let spike = field([32, 32], Boundary::Repeat, |i, j| if [i, j] == [13, 9] { 100.0 } else { 0.0 });
    let checkerboard = field([32, 32], Boundary::Clamp, |i, j| 50.0 * ((i + j) % 2) as f32);
    let steps = field([32, 32], Boundary::Repeat, |i, j| 80.0 * ((i / 3 + j / 5) % 2) as f32);
    for (name, fine) in [("spike", spike), ("checkerboard", checkerboard), ("steps", steps)] {
        for cells in [[4, 4], [3, 5], [1, 1], [32, 32]] {
            for count in 1..=MAX_LOBES {
                expect_sound(&fit_lobes(&fine, cells, Some(count)), cells[0] * cells[1], name);
            }
            expect_sound(&fit_lobes(&fine, cells, None), cells[0] * cells[1], name);
        }
    }
}

#[test]
fn fixtures_give_sound_lobes_at_8_and_64() {
    for (name, amplitude) in [("twill", 24.42), ("fbm", 58.54), ("cliffs", 120.0), ("bump", 28.0)] {
        let fine = fixture(name, amplitude);
        for cells in [128, 16] {
            expect_sound(&fit_lobes(&fine, [cells; 2], Some(6)), cells * cells, name);
        }
    }
}

#[test]
fn a_flat_map_is_one_lobe_of_the_greatest_concentration() {
    let fine = field([64, 64], Boundary::Repeat, |_, _| 0.7);
    assert_eq!(fit_lobes(&fine, [8, 8], None).len(), 1);
    let lobes = fit_lobes(&fine, [8, 8], Some(4));
    for lobe in &lobes[0] {
        assert_eq!((lobe.mean, lobe.kappa), ([0.0, 0.0, 1.0], MAX_KAPPA));
        // 1 / r(κ).
        assert!((lobe.weight - 1.0).abs() < 2e-6);
    }
    assert!(lobes.iter().skip(1).flatten().all(|lobe| lobe.weight == 0.0));
}

#[test]
fn a_groove_of_two_facets_is_two_lobes() {
    // Up by 1 a texel over 2, down by ½ over 4: slopes 1 and −½, base shares 1/3 and 2/3.
    let groove = |i: usize, _| if i % 6 < 2 { (i % 6) as f32 } else { 0.5 * (6 - i % 6) as f32 };
    let fine = field([48, 48], Boundary::Repeat, groove);
    assert_eq!(choose_lobe_count(&fine, [4, 4]), 2);
    for count in [2, 6] {
        let lobes = fit_lobes(&fine, [4, 4], Some(count));
        for (level, (share, slope)) in lobes.iter().zip([(2.0 / 3.0, -0.5_f32), (1.0 / 3.0, 1.0)]) {
            let stretch = (1.0 + slope * slope).sqrt();
            for lobe in level {
                let [x, y, z] = lobe.mean;
                assert!((x + slope / stretch).abs() < 1e-6 && y.abs() < 1e-6 && (z - 1.0 / stretch).abs() < 1e-6);
                assert!((lobe.weight - share * stretch).abs() < 3e-6, "weight {} of {}", lobe.weight, share * stretch);
                // 1 − r of equal normals is what f32 makes of zero.
                assert!(lobe.kappa > 0.5 * MAX_KAPPA, "kappa {}", lobe.kappa);
            }
        }
        assert!(lobes.iter().skip(2).flatten().all(|lobe| lobe.weight == 0.0));
    }
}

#[test]
fn cliffs_stand_on_their_walls() {
    // Terraces with walls of slope 80 on one texel in eight: micro-area 80.006/8 and 7/8.
    let fine = field([64, 64], Boundary::Clamp, |i, _| 80.0 * (i / 8) as f32);
    let lobes = fit_lobes(&fine, [4, 4], Some(2));
    // The last column of cells holds the texel that the repeated border makes flat.
    for cell in (0..16).filter(|cell| cell % 4 < 3) {
        let [wall, floor] = [lobes[0][cell], lobes[1][cell]];
        assert!((wall.weight - 80.00625 / 8.0).abs() < 1e-4 && (floor.weight - 0.875).abs() < 1e-4);
        assert!(wall.mean[0] < -0.9999 && floor.mean[2] > 0.9999);
    }
}

#[test]
fn the_lobe_count_follows_the_distribution() {
    let cases = [
        ("fbm", 58.5, 8.0, 2..=4),
        ("twill", 24.4, 8.0, 6..=6),
        ("twill", 24.4, 64.0, 8..=8),
        ("vgroove", 32.0, 64.0, 2..=2),
    ];
    for (name, amplitude, factor, wanted) in cases {
        let fine = fixture(name, amplitude);
        let count = choose_lobe_count(&fine, coarse_cells(fine.size(), factor));
        assert!(wanted.contains(&count), "{name} at {factor}: {count} lobes");
    }
}

#[test]
fn thread_counts_change_no_bit() {
    let fine = rough([200, 150], 3.0, Boundary::Repeat);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (fit_lobes(&fine, [61, 46], Some(6)), fit_lobes(&fine, [25, 19], None)))
    };
    assert_eq!(on(1), on(4));
}
