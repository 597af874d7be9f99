use super::mixture::{Lobe, Mixture, exp_neg};
use super::*;
use crate::geometry::Boundary;
use crate::math::vmf::{Vmf, kappa_from_one_minus_r, mean_resultant_length};
use glam::Vec3;

/// A fixture of fixtures/heights in texels.
fn fixture(name: &str, amplitude: f32) -> HeightField {
    let path = format!("{}/fixtures/heights/{name}.png", env!("CARGO_MANIFEST_DIR"));
    let map = image::open(path).unwrap().into_luma16();
    let size = [map.width() as usize, map.height() as usize];
    let heights = map.into_raw().iter().map(|&code| f32::from(code) / 65535.0 * amplitude).collect();
    HeightField::new(heights, size, [1.0, 1.0], Boundary::Repeat)
}

/// Mean log-likelihood of the samples under the mixture, in f64 and without any of the kernel's forms.
fn log_likelihood(samples: &MicroNormals, lobes: &[Lobe]) -> f64 {
    let total: f64 = lobes.iter().map(|l| f64::from(l.weight)).sum();
    let [mut sum, mut mass] = [0.0; 2];
    for k in 0..samples.len() {
        let (n, w) = samples.get(k);
        let density = |l: &Lobe| {
            let kappa = f64::from(l.kappa);
            let peak = kappa / (2.0 * std::f64::consts::PI * -(-2.0 * kappa).exp_m1());
            let t = 0.5 * (Vec3::from_array(n).as_dvec3() - l.mean.as_dvec3()).length_squared();
            (f64::from(l.weight) / total * peak, -kappa * t)
        };
        let terms: Vec<(f64, f64)> = lobes.iter().map(density).collect();
        let top = terms.iter().map(|t| t.1).fold(f64::MIN, f64::max);
        sum += f64::from(w) * (top + terms.iter().map(|(p, e)| p * (e - top).exp()).sum::<f64>().ln());
        mass += f64::from(w);
    }
    sum / mass
}

fn random_start(samples: &MicroNormals, count: usize, seed: usize) -> Mixture {
    let mut lobes = vec![];
    for j in 0..count {
        let k = (((seed * 37 + j * 101 + 11) as u32).wrapping_mul(2654435761) >> 8) as usize % samples.len();
        lobes.push(Lobe { weight: 1.0, mean: Vec3::from_array(samples.get(k).0), kappa: 20.0 });
    }
    Mixture { lobes }
}

#[test]
#[ignore]
fn experiment() {
    for (name, amp, factor) in [("fbm", 58.5, 8), ("twill", 24.4, 8), ("twill", 24.4, 64)] {
        let fine = fixture(name, amp);
        let cells = [1024 / factor; 2];
        let fp = Footprints::new(&fine, cells);
        for count in [2, 3, 4, 6, 8] {
            let [mut four, mut s0, mut ten, mut fifty, mut best] = [0.0; 5];
            let n = if factor == 8 { 40 } else { 5 };
            for c in 0..n {
                let mut s = MicroNormals::default();
                fp.gather([(c * 29 + 3) % cells[0], (c * 53 + 1) % cells[1]], &mut s);
                let m = start::split(&mut s, count);
                s0 += log_likelihood(&s, &m.lobes);
                let mut m4 = start::split(&mut s, count);
                for k in 0..50 {
                    m4.iterate(&s);
                    if k == 3 {
                        four += log_likelihood(&s, &m4.lobes);
                    }
                    if k == 9 {
                        ten += log_likelihood(&s, &m4.lobes);
                    }
                }
                fifty += log_likelihood(&s, &m4.lobes);
                best += (0..40)
                    .map(|seed| {
                        let mut r = random_start(&s, count, seed);
                        for _ in 0..60 {
                            r.iterate(&s);
                        }
                        log_likelihood(&s, &r.lobes)
                    })
                    .fold(f64::MIN, f64::max);
            }
            let n = n as f64;
            println!(
                "{name} {factor} L{count}: start {:.3} 4it {:.3} 10it {:.3} 50it {:.3} best {:.3}",
                s0 / n,
                four / n,
                ten / n,
                fifty / n,
                best / n
            );
        }
        let t = std::time::Instant::now();
        let l = fit_lobes(&fine, cells, Some(6));
        println!("time {:?} {:?}", t.elapsed(), l[0][5]);
    }
    let _ = (exp_neg(-1.0), kappa_from_one_minus_r(0.5), mean_resultant_length(1.0), Vmf { mean: Vec3::Z, kappa: 1.0 });
}

#[test]
#[ignore]
fn profile() {
    use std::time::Instant;
    for (name, amp, factor) in [("fbm", 58.5, 8), ("twill", 24.4, 8), ("twill", 24.4, 64)] {
        let fine = fixture(name, amp);
        let cells = [1024 / factor; 2];
        let fp = Footprints::new(&fine, cells);
        let mut s = MicroNormals::default();
        let mut t = [0.0; 5];
        let mut n = 0;
        for c in 0..cells[0] * cells[1] {
            let a = Instant::now();
            fp.gather([c % cells[0], c / cells[0]], &mut s);
            let b = Instant::now();
            let mut m = start::split(&mut s, 6);
            let d = Instant::now();
            m.refine(&s);
            let e = Instant::now();
            let l = m.into_lobes();
            let f = Instant::now();
            n += s.len() + (l[0].kappa < 0.0) as usize;
            for (k, x) in [b - a, d - b, e - d, f - e].iter().enumerate() {
                t[k] += x.as_secs_f64();
            }
        }
        println!(
            "PROF {name} {factor}: samples {n} gather {:.3} split {:.3} em {:.3} into {:.3}",
            t[0], t[1], t[2], t[3]
        );
    }
}
