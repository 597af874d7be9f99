use cpu_time::ProcessTime;
use farfield::geometry::{Boundary, HeightField};
use farfield::material::{Brdf, Conductor};
use farfield::prefilter::surface::*;
fn main() {
    for (name, amp) in [("twill", 24.41518951f32)] {
        let image = image::open(format!("fixtures/heights/{name}.png")).unwrap().into_luma16();
        let heights: Vec<f32> = image.pixels().map(|p| p[0] as f32 / 65535.0 * amp).collect();
        let field = HeightField::new(heights, [1024, 1024], [1.0; 2], Boundary::Repeat);
        for alpha in [None] {
            let brdf = Brdf {
                diffuse: [if alpha.is_some() { 0.0 } else { 0.5 }; 3],
                specular: alpha.map(|alpha| Conductor { alpha, f0: [0.9; 3] }),
            };
            let surface = FineSurface { heights: field.clone(), brdf, color: None };
            let mut last = ProcessTime::now();
            print!("{name} {alpha:?}: ");
            let all = ProcessTime::now();
            let l = compile(
                &surface,
                &LevelSettings { factor: 8.0, patches: 4, directions: 15, rank: 1, lobes: None, seed: 0 },
                &mut |s| {
                    print!("{:.2} {s} ", last.elapsed().as_secs_f64());
                    last = ProcessTime::now();
                },
            );
            println!(
                "{:.2} end. total {:.2} on_node {:.4} lobes {} {:?}",
                last.elapsed().as_secs_f64(),
                all.elapsed().as_secs_f64(),
                l.on_node,
                l.lobes.len(),
                l.warnings
            );
        }
    }
}
