//! Shadow sweeps of twill (1024²): texels a second for each copy of the kernel, and visibility bits for all table
//! directions: `cargo bench --bench visibility`.

use cpu_time::{ProcessTime, ThreadTime};
use farfield::geometry::{Boundary, HeightField};
use farfield::math::simd::{self, Kernel};
use farfield::prefilter::surface::visibility::{ShadowSweep, VisibilityBits};

fn main() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/heights/twill.png");
    let image = image::open(path).expect("a fixture of this repository").into_luma16();
    let heights: Vec<f32> = image.pixels().map(|code| f32::from(code[0]) / 65535.0 * 24.415_19).collect();
    let field = HeightField::new(heights, [1024, 1024], [1.0, 1.0], Boundary::Repeat);
    let directions = formats::lookup::direction_grid(15);
    let sweep = ShadowSweep::new(&field);
    let mut masks = [vec![0_u8; 1 << 20], vec![0_u8; 1 << 20]];
    let mut seconds = [0.0; 2];
    for &w in &directions {
        for (copy, mask) in masks.iter_mut().enumerate() {
            let start = ThreadTime::now();
            let (kernel, _) = sweep.kernel(w, mask);
            if copy == 0 {
                kernel.run()
            } else {
                simd::run(kernel)
            }
            seconds[copy] += start.elapsed().as_secs_f64();
        }
        assert_eq!(masks[0], masks[1], "every copy of a kernel gives the same bytes");
    }
    for (name, seconds) in ["plain", "dispatched"].iter().zip(seconds) {
        let rate = (directions.len() << 20) as f64 / seconds * 1e-6;
        println!("visibility/sweep_{name}/1024: {seconds:.3} core-seconds for 225 directions, {rate:.0} M texels/s");
    }
    println!("visibility/sweep/1024: dispatched over plain {:.2}", seconds[0] / seconds[1]);
    let start = ProcessTime::now();
    let bits = VisibilityBits::sweep(&field, &directions, (0..1 << 20).collect());
    let lit: u32 = (0..directions.len()).flat_map(|d| bits.direction(d)).map(|word| word.count_ones()).sum();
    let seconds = start.elapsed().as_secs_f64();
    println!("visibility/bits/1024: {seconds:.3} core-seconds for 225 directions, {lit} lit");
}
