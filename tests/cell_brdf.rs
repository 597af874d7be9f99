//! f_c in closed form against quadrature over the normals, with the error bounds written down.

use farfield::material::ggx_gaussians;
use formats::cell_brdf::{BaseBrdf, CellBrdf, Lobe, LobeKernel, Specular, half_vector};
use std::f64::consts::PI;

/// Points per axis of the quadrature.
const STEPS: usize = 200;

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn wide(v: [f32; 3]) -> [f64; 3] {
    let v = v.map(f64::from);
    let length = dot(v, v).sqrt();
    v.map(|x| x / length)
}

/// Any orthonormal frame around `z`.
fn frame(z: [f64; 3]) -> [[f64; 3]; 3] {
    let a = if z[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let x = cross(a, z);
    let length = dot(x, x).sqrt();
    let x = x.map(|v| v / length);
    [x, cross(z, x), z]
}

/// Mean of `g` over quantiles of a distribution around `axis`; `one_minus_cos(u)` is its inverse distribution function.
fn integrate(axis: [f64; 3], one_minus_cos: impl Fn(f64) -> f64, g: impl Fn([f64; 3], f64) -> f64) -> f64 {
    let [x, y, z] = frame(axis);
    let mut sum = 0.0;
    for a in 0..STEPS {
        let d = one_minus_cos((a as f64 + 0.5) / STEPS as f64);
        let (c, s) = (1.0 - d, (d * (2.0 - d)).max(0.0).sqrt());
        for b in 0..STEPS {
            let (sin, cos) = (2.0 * PI * (b as f64 + 0.5) / STEPS as f64).sin_cos();
            let n = [0, 1, 2].map(|k| s * cos * x[k] + s * sin * y[k] + c * z[k]);
            sum += g(n, d);
        }
    }
    sum / (STEPS * STEPS) as f64
}

/// 1 − cos of the quantile `u` of a vMF lobe.
fn vmf_quantile(kappa: f64, u: f64) -> f64 {
    if kappa < 1e-6 { 2.0 * u } else { -((1.0 - u) + u * (-2.0 * kappa).exp()).ln() / kappa }
}

fn vmf_density(kappa: f64, one_minus_cos: f64) -> f64 {
    if kappa < 1e-6 {
        return 0.25 / PI;
    }
    kappa / (2.0 * PI * (1.0 - (-2.0 * kappa).exp())) * (-kappa * one_minus_cos).exp()
}

/// ∫ ⟨n, ωi⟩⟨n, ωo⟩ γ(n) dn.
fn exact_cosines(mu: [f64; 3], kappa: f64, wi: [f64; 3], wo: [f64; 3]) -> f64 {
    integrate(mu, |u| vmf_quantile(kappa, u), |n, _| dot(n, wi).max(0.0) * dot(n, wo).max(0.0))
}

fn exact_facing(mu: [f64; 3], kappa: f64, w: [f64; 3]) -> f64 {
    integrate(mu, |u| vmf_quantile(kappa, u), |n, _| dot(n, w).max(0.0))
}

/// D·G/4 of GGX for the facet n; 0 where a direction lies behind it.
fn ggx_numerator(alpha: f64, n: [f64; 3], h: [f64; 3], wi: [f64; 3], wo: [f64; 3]) -> f64 {
    let (ci, co, c) = (dot(n, wi), dot(n, wo), dot(n, h));
    if ci <= 0.0 || co <= 0.0 || c <= 0.0 {
        return 0.0;
    }
    let a2 = alpha * alpha;
    let d = a2 / (PI * ((1.0 - c * c) + a2 * c * c).powi(2));
    let smith = |c: f64| (a2 + (1.0 - a2) * c * c).sqrt();
    d * 2.0 * ci * co / (ci * smith(co) + co * smith(ci)) / 4.0
}

/// ∫ D G/4 γ dn, over quantiles of whichever of base NDF and lobe is narrower.
fn exact_specular(mu: [f64; 3], kappa: f64, alpha: f64, wi: [f64; 3], wo: [f64; 3]) -> f64 {
    let h = wide([0, 1, 2].map(|k| (wi[k] + wo[k]) as f32));
    if kappa * alpha * alpha > 2.0 {
        return integrate(mu, |u| vmf_quantile(kappa, u), |n, _| ggx_numerator(alpha, n, h, wi, wo));
    }
    let a2 = alpha * alpha;
    // quantiles of D cosθ: tan²θ = α² u/(1 − u)
    let quantile = |u: f64| 1.0 - 1.0 / (1.0 + a2 * u / (1.0 - u)).sqrt();
    integrate(h, quantile, |n, d| {
        let c: f64 = 1.0 - d;
        let density = a2 / (PI * ((1.0 - c * c) + a2 * c * c).powi(2)) * c;
        let m = [0, 1, 2].map(|k| n[k] - mu[k]);
        ggx_numerator(alpha, n, h, wi, wo) / density * vmf_density(kappa, 0.5 * dot(m, m))
    })
}

/// Van der Corput's sequence.
fn radical_inverse(mut k: usize, base: usize) -> f64 {
    let (mut f, mut r) = (1.0, 0.0);
    while k > 0 {
        f /= base as f64;
        r += f * (k % base) as f64;
        k /= base;
    }
    r
}

/// Triples (μ, ωi, ωo) in the upper hemisphere: directions below 75°, means below 60°.
fn triples(count: usize) -> Vec<[[f32; 3]; 3]> {
    let direction = |a: f64, b: f64, low: f64| {
        let z = low + (1.0 - low) * a;
        let (s, c) = (2.0 * PI * b).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [(r * c) as f32, (r * s) as f32, z as f32]
    };
    (1..=count)
        .map(|k| {
            let u = [2, 3, 5, 7, 11, 13].map(|base| radical_inverse(k, base));
            [direction(u[0], u[1], 0.5), direction(u[2], u[3], 0.26), direction(u[4], u[5], 0.26)]
        })
        .collect()
}

/// Largest and root mean square error, relative to the root mean square of the exact values.
fn compare(pairs: &[[f64; 2]]) -> [f64; 2] {
    let scale = (pairs.iter().map(|[exact, _]| exact * exact).sum::<f64>() / pairs.len() as f64).sqrt();
    let worst = pairs.iter().map(|[exact, got]| (got - exact).abs() / scale).fold(0.0, f64::max);
    let square = pairs.iter().map(|[exact, got]| ((got - exact) / scale).powi(2)).sum::<f64>() / pairs.len() as f64;
    [worst, square.sqrt()]
}

const KAPPAS: [f32; 9] = [0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1e4, 1e6];

#[test]
fn projected_area_is_within_its_bound_of_quadrature() {
    for kappa in KAPPAS {
        let worst = triples(60)
            .iter()
            .map(|&[mu, w, _]| {
                let exact = exact_facing(wide(mu), kappa.into(), wide(w));
                (exact - f64::from(LobeKernel::new(mu, kappa).facing(w).mean)).abs()
            })
            .fold(0.0, f64::max);
        println!("kappa {kappa}: P within {worst:.5}");
        assert!(worst < 0.02, "kappa {kappa}: {worst}");
    }
}

#[test]
fn diffuse_numerator_is_within_its_bound_of_quadrature() {
    for kappa in KAPPAS {
        let pairs: Vec<[f64; 2]> = triples(80)
            .iter()
            .map(|&[mu, wi, wo]| {
                let kernel = LobeKernel::new(mu, kappa);
                let cos_io = dot(wi.map(f64::from), wo.map(f64::from)) as f32;
                let got = kernel.cosines(kernel.facing(wi), kernel.facing(wo), cos_io);
                [exact_cosines(wide(mu), kappa.into(), wide(wi), wide(wo)), got.into()]
            })
            .collect();
        let [worst, rms] = compare(&pairs);
        println!("kappa {kappa}: diffuse N worst {worst:.4} rms {rms:.4} of its root mean square");
        let [worst_bound, rms_bound] = if kappa < 10.0 { [0.14, 0.07] } else { [0.02, 0.006] };
        assert!(worst < worst_bound && rms < rms_bound, "kappa {kappa}: {worst} {rms}");
    }
}

#[test]
fn specular_numerator_is_within_its_bound_of_quadrature() {
    for alpha in [0.02_f32, 0.1, 0.3, 1.0] {
        let specular = Specular { f0: [1.0; 3], alpha, gaussians: ggx_gaussians(alpha) };
        for kappa in KAPPAS {
            let pairs: Vec<[f64; 2]> = triples(80)
                .iter()
                .map(|&[mu, wi, wo]| {
                    let kernel = LobeKernel::new(mu, kappa);
                    let [ci, co] = [wi, wo].map(|w| kernel.facing(w).cos_mean);
                    let got = kernel.specular(specular.view(), half_vector(wi, wo).1, ci, co);
                    [exact_specular(wide(mu), kappa.into(), alpha.into(), wide(wi), wide(wo)), got.into()]
                })
                .collect();
            let [worst, rms] = compare(&pairs);
            println!("alpha {alpha} kappa {kappa}: specular N worst {worst:.4} rms {rms:.4} of its root mean square");
            // wide lobes under a wide base lobe: G at the mean cosines is no longer the mean of G
            let [worst_bound, rms_bound] = match kappa {
                k if k < 10.0 && alpha > 0.5 => [1.5, 0.8],
                k if k < 10.0 => [0.45, 0.21],
                k if k < 100.0 => [0.4, 0.16],
                _ => [0.32, 0.04],
            };
            assert!(worst < worst_bound && rms < rms_bound, "alpha {alpha} kappa {kappa}: {worst} {rms}");
        }
    }
}

#[test]
fn a_cell_is_reciprocal_and_a_flat_one_is_its_base_brdf() {
    let brdf = BaseBrdf {
        diffuse: [0.5, 0.25, 0.1],
        specular: Some(Specular { f0: [0.9, 0.5, 0.04], alpha: 0.3, gaussians: ggx_gaussians(0.3) }),
    };
    let flat = Lobe { mean: [0.0, 0.0, 1.0], kappa: 1e6, weight: 1.0 };
    let tilted = Lobe { mean: [0.6, 0.0, 0.8], kappa: 12.0, weight: 0.4 };
    let rough = CellBrdf::new([flat, tilted], &brdf, [1.0; 3]);
    let plane = CellBrdf::new([flat], &brdf, [1.0; 3]);
    for [_, wi, wo] in triples(200) {
        let n = [0.0, 0.0, 1.0];
        let (there, back) = (rough.eval(n, wi, wo), rough.eval(n, wo, wi));
        // the formulas are symmetric; only the order of rounding differs
        (0..3).for_each(|k| assert!((there[k] - back[k]).abs() <= 2e-6 * there[k].abs()));
        let (h, _) = half_vector(wi, wo);
        let [wide_i, wide_o, wide_h] = [wi, wo, h].map(wide);
        let specular = ggx_numerator(0.3, [0.0, 0.0, 1.0], wide_h, wide_i, wide_o) / (wide_i[2] * wide_o[2]);
        let schlick = (1.0 - dot(wide_h, wide_i)).powi(5);
        for (k, got) in plane.eval(n, wi, wo).into_iter().enumerate() {
            let f0 = [0.9, 0.5, 0.04][k];
            let exact = [0.5, 0.25, 0.1][k] / PI + (f0 + (1.0 - f0) * schlick) * specular;
            assert!((f64::from(got) / exact - 1.0).abs() < 0.045, "{got} {exact}");
        }
    }
}
