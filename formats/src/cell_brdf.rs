//! The BRDF of a coarse cell in closed form: f_c = N_c / (⟨n_c, ωg⟩ P_c(ωi) P_c(ωo)).
//!
//! One formula serves the compiler that divides by it and the renderer that multiplies with it: whatever smooth error
//! it has is then taken up by the scaling function. N_c and P_c are sums over the cell's von Mises-Fisher lobes,
//!
//! ```text
//! P_c(ω)      = Σ_j w_j P_j(ω)         P_j(ω)      = ∫ ⟨n, ω⟩ γ_j(n) dn
//! N_c(ωi, ωo) = Σ_j w_j N_j(ωi, ωo)    N_j(ωi, ωo) = ∫ f(n; ωi, ωo) ⟨n, ωi⟩ ⟨n, ωo⟩ γ_j(n) dn
//! ```
//!
//! with f the base BRDF for a facet of normal n, ⟨·,·⟩ clamped at 0 and all directions unit vectors that point away
//! from the surface, in the frame of the base plane (z = ωg). Values are 1/sr, RGB, without a cosine, and symmetric
//! in ωi and ωo by construction.

pub(crate) mod lanes;

use std::borrow::Cow;
use std::f32::consts::{FRAC_1_PI, FRAC_2_PI, PI};

/// One von Mises-Fisher lobe of a cell's normal distribution; weight 0 means unused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lobe {
    /// Mean direction μ, unit, frame of the base plane.
    pub mean: [f32; 3],
    /// Concentration κ in [0, 1e6]; 0 is uniform over the sphere.
    pub kappa: f32,
    /// Micro-area per base area.
    pub weight: f32,
}

/// The base BRDF: `diffuse`/π plus an optional GGX conductor.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseBrdf {
    /// Albedo of the Lambertian part, linear RGB.
    pub diffuse: [f32; 3],
    /// The rough specular part.
    pub specular: Option<Specular>,
}

/// A GGX conductor: D·G·F/(4 cosθi cosθo), height-correlated Smith G, Schlick's F.
#[derive(Clone, Debug, PartialEq)]
pub struct Specular {
    /// Reflectance at normal incidence, linear RGB.
    pub f0: [f32; 3],
    /// Roughness α, 0 < α <= 1.
    pub alpha: f32,
    /// D as spherical Gaussians, (λ, amplitude) each: D(h·n) ≈ Σ amplitude·exp(λ(h·n − 1)).
    pub gaussians: Vec<[f32; 2]>,
}

/// Below this P_c a cell does not face the direction, and f_c is 0.
pub const MIN_FACING: f32 = 1e-6;

/// exp(x) for x <= 0, within 3e-7 of the value; e^−60 below −60.
///
/// The floor is 9e-27: what it is multiplied with stays a normal number, and subnormal ones are slow.
///
/// 2^n · 2^f with |f| <= ½ and the Taylor polynomial of degree 6 for 2^f: the same bits on every platform, and plain
/// arithmetic that compilers vectorise.
#[inline(always)]
pub fn exp_neg(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5·2²³: adding it leaves the nearest integer in the low mantissa bits
    let y = x.max(-60.0) * std::f32::consts::LOG2_E;
    let shifted = y + ROUND;
    let f = y - (shifted - ROUND);
    // Pairs instead of one long chain: every step of a chain waits for the one before.
    let (f2, f4) = (f * f, f * f * (f * f));
    let low = (1.0 + 6.931_472e-1 * f) + f2 * (2.402_265e-1 + 5.550_411e-2 * f);
    let p = low + f4 * ((9.618_129e-3 + 1.333_355_8e-3 * f) + f2 * 1.540_353e-4);
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[inline(always)]
pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// What one lobe needs of one direction ω; see [`LobeKernel::facing`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Facing {
    /// c = μ·ω.
    pub cos_mean: f32,
    /// P_j(ω), the mean of ⟨n, ω⟩.
    pub mean: f32,
    /// The mean of ⟨n, ω⟩ if n·ω were normally distributed.
    pub normal_mean: f32,
    /// Φ(z), the fraction of normals that face ω.
    pub fraction: f32,
    /// e/s with s² = Var(n·ω) and e² = Var⟨n, ω⟩/s² − Φ².
    pub excess: f32,
}

/// The constants of one lobe, ready for many directions. The weight is not included: P_j and N_j are per unit weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LobeKernel {
    mean: [f32; 3],
    kappa: f32,
    /// κ/(1 − e^{−2κ}); ½ for κ = 0.
    norm: f32,
    /// Mean resultant length r = coth κ − 1/κ.
    resultant: f32,
    /// Variance of n·ω across μ: r/κ.
    var_across: f32,
    /// Variance of n·μ: 1/κ² − 1/sinh²κ.
    var_along: f32,
    /// What the Gaussian tail lacks for wide lobes: I₁(κ)/(2 sinh κ) over √(r/κ)/√(2π), 1.085 at κ = 0.
    widen: f32,
}

impl LobeKernel {
    /// Mean direction μ.
    pub fn mean(&self) -> [f32; 3] {
        self.mean
    }

    /// Concentration κ.
    pub fn kappa(&self) -> f32 {
        self.kappa
    }

    /// The constants of the lobe (μ, κ).
    pub fn new(mean: [f32; 3], kappa: f32) -> Self {
        let k = f64::from(kappa);
        // Series below: the closed forms subtract 1/κ from coth κ and 1/sinh² from 1/κ².
        let (resultant, var_across, var_along) = if k < 0.03 {
            (k / 3.0 - k.powi(3) / 45.0, 1.0 / 3.0 - k * k / 45.0, 1.0 / 3.0 - k * k / 15.0)
        } else {
            let e = (-2.0 * k).exp();
            let r = (1.0 + e) / (1.0 - e) - 1.0 / k;
            (r, r / k, 1.0 / (k * k) - 4.0 * e / ((1.0 - e) * (1.0 - e)))
        };
        let norm = if k < 1e-6 { 0.5 } else { k / (1.0 - (-2.0 * k).exp()) };
        Self {
            mean,
            kappa,
            norm: norm as f32,
            resultant: resultant as f32,
            var_across: var_across as f32,
            var_along: var_along as f32,
            widen: (1.0 + 0.0854 / (1.0 + (0.678 * k).powi(2)).sqrt()) as f32,
        }
    }

    /// P_j(ω) and the moments of ⟨n, ω⟩ that [`LobeKernel::cosines`] needs, with n·ω taken as normally distributed.
    ///
    /// m = r μ·ω and s² = (r/κ)(1 − (μ·ω)²) + Var(n·μ)(μ·ω)² are the exact mean and variance of n·ω. With z = m/s,
    /// t(z) = φ(z) − |z|Φ(−|z|) and q(z) = (z² + 1)Φ(−|z|) − |z|φ(z), both as φ times a rational function (within
    /// 5e-5 of themselves), the clamped mean is max(m, 0) + s t, and the clamped second moment s² q for z < 0.
    /// For P_j, t is widened so that wide lobes seen from the side are exact.
    #[inline(always)]
    pub fn facing(&self, w: [f32; 3]) -> Facing {
        let c = dot(self.mean, w);
        let m = self.resultant * c;
        let s = (self.var_across * (1.0 - c * c).max(0.0) + self.var_along * c * c).sqrt();
        let per_s = 1.0 / s.max(1e-9);
        let z = (m * per_s).abs().min(8.0);
        let phi = 0.398_942_3 * exp_neg(-0.5 * z * z);
        let t = phi * (1.0 + z * (0.412_607_1 + z * 0.079_286_79))
            / (1.0 + z * (1.665_448_9 + z * (1.169_974_5 + z * (0.418_329_13 + z * 0.079_094_53))));
        let q = phi * (1.253_314_1 + z * (0.440_773_6 + z * 0.077_009_19))
            / (1.0 + z * (1.947_749_8 + z * (1.666_949_7 + z * (0.811_491_7 + z * (0.223_708_7 + z * 0.038_407_24)))));
        let averted = (q + z * phi) / (z * z + 1.0); // Φ(−|z|)
        let faces = m >= 0.0;
        let fraction = if faces { 1.0 - averted } else { averted };
        // Var⟨x⟩/Var x − Φ² is q − t² − Φ(−|z|)² on either side of z = 0; written for z > 0 it would be a difference of
        // numbers near 1. max(0): rounding of the tail, where all terms are near 0
        let excess = (q - t * t - averted * averted).max(0.0).sqrt() * per_s;
        let positive = m.max(0.0);
        Facing { cos_mean: c, mean: positive + self.widen * s * t, normal_mean: positive + s * t, fraction, excess }
    }

    /// ∫ ⟨n, ωi⟩ ⟨n, ωo⟩ γ(n) dn; `cos_io` = ωi·ωo.
    ///
    /// For jointly normal x = n·ωi, y = n·ωo of correlation ρ, the derivative of E⟨x⟩⟨y⟩ by ρ at ρ = 0 is
    /// s_i s_o Φ_i Φ_o (Price's theorem); the term in ρ² makes ρ = 1 exact for ωi = ωo:
    ///
    /// N_j = P_i P_o + cov(x, y) Φ_i Φ_o + cov(x, y)² · e_i/s_i · e_o/s_o,   e² = Var⟨x⟩/Var x − Φ²
    ///
    /// where cov(x, y) = (r/κ)(ωi·ωo − c_i c_o) + Var(n·μ) c_i c_o is exact. Unclamped it is all exact (Φ = 1, e = 0).
    #[inline(always)]
    pub fn cosines(&self, i: Facing, o: Facing, cos_io: f32) -> f32 {
        let along = i.cos_mean * o.cos_mean;
        let covariance = self.var_across * (cos_io - along) + self.var_along * along;
        let independent = i.normal_mean * o.normal_mean;
        let correlated = covariance * (i.fraction * o.fraction + covariance * i.excess * o.excess);
        // the quadratic in ρ may end a little below 0 at ρ = −1, where the truth is 0
        (independent + correlated).max(1e-3 * independent)
    }

    /// ∫ D(h·n) G(n; ωi, ωo)/4 γ(n) dn, which is N_j of a conductor without its Fresnel term.
    ///
    /// `cos_half` = ωi·h = ωo·h, `ci` = μ·ωi and `co` = μ·ωo.
    #[inline(always)]
    pub fn specular(&self, specular: SpecularRef<'_>, cos_half: f32, ci: f32, co: f32) -> f32 {
        let gaussians = specular.gaussians.iter();
        gaussians.map(|&gaussian| self.specular_term(specular.alpha, gaussian, cos_half, ci, co)).sum()
    }

    /// One Gaussian (λ, amplitude) of [`LobeKernel::specular`]; their sum is taken in the order of the Gaussians.
    ///
    /// The product of a spherical Gaussian (λ, h) with the lobe is itself a vMF lobe, integrated exactly, and G is
    /// taken at its mean cosines.
    #[inline(always)]
    pub fn specular_term(&self, alpha: f32, gaussian: [f32; 2], cos_half: f32, ci: f32, co: f32) -> f32 {
        let one_minus_cos = one_minus_half_cosine(cos_half, ci, co);
        let k = self.product_kappa(gaussian[0], one_minus_cos);
        self.product_mass(gaussian, one_minus_cos, k) * self.shadowing(alpha, gaussian[0], cos_half, ci, co, k)
    }

    /// Concentration K = |λh + κμ| of the product of the lobe with a Gaussian (λ, h), from 1 − h·μ.
    #[inline(always)]
    pub(crate) fn product_kappa(&self, lambda: f32, one_minus_cos: f32) -> f32 {
        let total = self.kappa + lambda;
        (total * total - 2.0 * lambda * self.kappa * one_minus_cos).max(0.0).sqrt().max(1e-4)
    }

    /// ∫ amplitude·exp(λ(h·n − 1)) γ(n) dn, for `k` = [`LobeKernel::product_kappa`].
    ///
    /// norm(κ) · exp(−2λκ(1 − h·μ)/(K + κ + λ)) · (1 − e^{−2K})/K
    #[inline(always)]
    pub(crate) fn product_mass(&self, [lambda, amplitude]: [f32; 2], one_minus_cos: f32, k: f32) -> f32 {
        let cross = 2.0 * lambda * self.kappa * one_minus_cos;
        let decay = exp_neg(-cross / (k + self.kappa + lambda));
        self.norm * amplitude * decay * (1.0 - exp_neg(-2.0 * k)) / k
    }

    /// G/4: height-correlated Smith shadowing at the mean cosines of the product with ωi and ωo, softly clamped.
    #[inline(always)]
    pub(crate) fn shadowing(&self, alpha: f32, lambda: f32, cos_half: f32, ci: f32, co: f32, k: f32) -> f32 {
        // r(K) ≈ K/(K + 1 + 2/(1 + K)): exact in both limits, within 0.02 of coth K − 1/K.
        // E⟨n, ω⟩ of a vMF lobe at a right angle is √(1/(2πK)), and ¼ for K = 0. One division for both.
        let [shrink_by, soft_by] = [(k + 1.0) * (k + 1.0) + 2.0, k + 2.546_5];
        let inverse = 1.0 / (shrink_by * soft_by);
        let shrink = (k + 1.0) * soft_by * inverse;
        let soft = FRAC_2_PI * shrink_by * inverse;
        let near = lambda * cos_half;
        let i = soft_cosine((near + self.kappa * ci) * shrink, soft);
        let o = soft_cosine((near + self.kappa * co) * shrink, soft);
        let a2 = alpha * alpha;
        let smith_i = (a2 + (1.0 - a2) * i * i).sqrt();
        let smith_o = (a2 + (1.0 - a2) * o * o).sqrt();
        0.5 * i * o / (i * smith_o + o * smith_i).max(1e-12)
    }
}

/// 1 − h·μ from `cos_half` = ωi·h and the cosines of μ with both directions.
#[inline(always)]
pub(crate) fn one_minus_half_cosine(cos_half: f32, ci: f32, co: f32) -> f32 {
    (1.0 - (ci + co) * (0.5 / cos_half.max(5e-10))).clamp(0.0, 2.0)
}

/// A smooth max(x, 0), at most 1.
#[inline(always)]
pub(crate) fn soft_cosine(x: f32, soft: f32) -> f32 {
    (0.5 * (x + (x * x + soft).sqrt())).clamp(0.0, 1.0)
}

/// What [`LobeKernel::specular`] needs of a [`Specular`].
#[derive(Clone, Copy, Debug)]
pub struct SpecularRef<'a> {
    /// Roughness α.
    pub alpha: f32,
    /// (λ, amplitude) each.
    pub gaussians: &'a [[f32; 2]],
}

impl Specular {
    /// The view that lobes are evaluated with.
    pub fn view(&self) -> SpecularRef<'_> {
        SpecularRef { alpha: self.alpha, gaussians: &self.gaussians }
    }
}

/// The unit vector halfway between ωi and ωo, and its cosine with either.
#[inline(always)]
pub fn half_vector(wi: [f32; 3], wo: [f32; 3]) -> ([f32; 3], f32) {
    let h = [wi[0] + wo[0], wi[1] + wo[1], wi[2] + wo[2]];
    let length = dot(h, h).sqrt().max(1e-9);
    ([h[0] / length, h[1] / length, h[2] / length], 0.5 * length)
}

/// Schlick's (1 − cosθ)⁵.
#[inline(always)]
pub fn schlick_weight(cos_theta: f32) -> f32 {
    let x = (1.0 - cos_theta).clamp(0.0, 1.0);
    let x2 = x * x;
    x2 * x2 * x
}

/// A [`BaseBrdf`] under a cell's colour: what turns the sums over lobes into RGB.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tint {
    /// diffuse·color/π.
    diffuse: [f32; 3],
    /// f0·color; 0 without a specular part.
    f0: [f32; 3],
}

impl Tint {
    pub(crate) fn new(brdf: &BaseBrdf, color: [f32; 3]) -> Self {
        Self {
            diffuse: std::array::from_fn(|k| brdf.diffuse[k] * color[k] * FRAC_1_PI),
            f0: std::array::from_fn(|k| brdf.specular.as_ref().map_or(0.0, |s| s.f0[k]) * color[k]),
        }
    }

    /// N_c from Σ w_j·cosines_j and Σ w_j·specular_j, RGB; `cos_half` = ωi·h.
    #[inline(always)]
    pub(crate) fn numerator(&self, diffuse: f32, specular: f32, cos_half: f32) -> [f32; 3] {
        let schlick = schlick_weight(cos_half);
        std::array::from_fn(|k| self.diffuse[k] * diffuse + (self.f0[k] + (1.0 - self.f0[k]) * schlick) * specular)
    }

    /// Albedos of the diffuse and of the specular part at the cosine `cos_theta`, mean of RGB; no shadowing.
    pub(crate) fn albedos(&self, cos_theta: f32) -> [f32; 2] {
        let mean = |rgb: [f32; 3]| (rgb[0] + rgb[1] + rgb[2]) / 3.0;
        let f0 = mean(self.f0);
        [PI * mean(self.diffuse), f0 + (1.0 - f0) * schlick_weight(cos_theta)]
    }
}

/// The BRDF of one cell.
#[derive(Clone, Debug)]
pub struct CellBrdf<'a> {
    /// (weight, kernel) of each lobe in use.
    lobes: Cow<'a, [(f32, LobeKernel)]>,
    conductor: Option<SpecularRef<'a>>,
    tint: Tint,
}

impl<'a> CellBrdf<'a> {
    /// The cell with these lobes; `color` multiplies the diffuse albedo and `f0` (1 where there is no colour map).
    pub fn new(lobes: impl IntoIterator<Item = Lobe>, brdf: &'a BaseBrdf, color: [f32; 3]) -> Self {
        let lobes = prepared(lobes).collect();
        Self {
            lobes: Cow::Owned(lobes),
            conductor: brdf.specular.as_ref().map(Specular::view),
            tint: Tint::new(brdf, color),
        }
    }

    /// The cell with these lobes as [`prepared`] gives them; else as [`CellBrdf::new`].
    pub fn of_prepared(lobes: &'a [(f32, LobeKernel)], brdf: &'a BaseBrdf, color: [f32; 3]) -> Self {
        let conductor = brdf.specular.as_ref().map(Specular::view);
        Self { lobes: Cow::Borrowed(lobes), conductor, tint: Tint::new(brdf, color) }
    }

    /// P_c(ω): projected micro-area per base area, without masking.
    pub fn facing(&self, w: [f32; 3]) -> f32 {
        self.lobes.iter().map(|(weight, lobe)| weight * lobe.facing(w).mean).sum()
    }

    /// N_c / (P_c(ωi) P_c(ωo)): f_c but for the factor 1/⟨n_c, ωg⟩; 0 where a P_c is below [`MIN_FACING`].
    pub fn normalised(&self, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let [pi, po] = [self.facing(wi), self.facing(wo)];
        if pi < MIN_FACING || po < MIN_FACING {
            return [0.0; 3];
        }
        let numerator = self.numerator(wi, wo);
        let scale = 1.0 / (pi * po);
        numerator.map(|n| n * scale)
    }

    /// N_c(ωi, ωo), RGB.
    pub fn numerator(&self, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let cos_half = half_vector(wi, wo).1;
        let cos_io = dot(wi, wo);
        let [mut diffuse, mut specular] = [0.0; 2];
        for (weight, lobe) in self.lobes.iter() {
            let [i, o] = [wi, wo].map(|w| lobe.facing(w));
            diffuse += weight * lobe.cosines(i, o, cos_io);
            if let Some(conductor) = self.conductor {
                specular += weight * lobe.specular(conductor, cos_half, i.cos_mean, o.cos_mean);
            }
        }
        self.tint.numerator(diffuse, specular, cos_half)
    }

    /// f_c(ωi, ωo) for the normal `n_c` of the coarse surface at the hit; 1/sr, RGB, cosine not included.
    ///
    /// 0 if either direction is below the base plane or not faced by any lobe.
    pub fn eval(&self, n_c: [f32; 3], wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        if wi[2] <= 0.0 || wo[2] <= 0.0 || n_c[2] <= 0.0 {
            return [0.0; 3];
        }
        self.normalised(wi, wo).map(|f| f / n_c[2])
    }
}

/// The lobes in use (weight > 0) with their constants, in their order.
pub fn prepared(lobes: impl IntoIterator<Item = Lobe>) -> impl Iterator<Item = (f32, LobeKernel)> {
    let used = lobes.into_iter().filter(|lobe| lobe.weight > 0.0);
    used.map(|lobe| (lobe.weight, LobeKernel::new(lobe.mean, lobe.kappa)))
}
