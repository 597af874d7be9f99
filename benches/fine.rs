use farfield::geometry::{Boundary, HeightField};
use farfield::material::{Brdf, Conductor};
use farfield::prefilter::surface::{FineSurface, fine, reflectance::TableDirections};
use cpu_time::ProcessTime;
fn main() {
    let image = image::open("fixtures/heights/twill.png").unwrap().into_luma16();
    let heights: Vec<f32> = image.pixels().map(|p| p[0] as f32 / 65535.0 * 24.41518951).collect();
    let field = HeightField::new(heights, [1024, 1024], [1.0; 2], Boundary::Repeat);
    for alpha in [None, Some(0.3), Some(0.1)] {
        let brdf = Brdf { diffuse: [if alpha.is_some() { 0.0 } else { 0.5 }; 3], specular: alpha.map(|alpha| Conductor { alpha, f0: [0.9; 3] }) };
        let surface = FineSurface { heights: field.clone(), brdf, color: None };
        let d = TableDirections::new(15);
        let mut last = ProcessTime::now();
        let f = fine::fine_reflectance(&surface, [4, 4], &d, &mut |s| { println!("{:.3} then {s}", last.elapsed().as_secs_f64()); last = ProcessTime::now(); });
        println!("{:.3} end  F(0,0..) {:?}", last.elapsed().as_secs_f64(), &f.channel(0, 0)[6000..6004]);
    }
}
