//! Microflakes: projected area, normal density and phase function of SGGX lobes and of their mixtures.
//!
//! A voxel of a volume holds the density ρ of flake area (1/m) and lobes j with area fractions φ_j (Σ φ_j = 1), SGGX
//! matrices S_j and RGB albedos a_j. Flakes are mirrors, so
//!
//! ```text
//! σ_j(ω)   = √(ωᵀ S_j ω)                                projected flake area
//! D_j(m)   = 1 / (π √|S_j| (mᵀ S_j⁻¹ m)²)               density of flake normals, 1/sr
//! σ_t(ω)   = ρ Σ_j φ_j σ_j(ω)                           extinction, 1/m
//! p(ω, ω′) = Σ_j a_j φ_j D_j(h) / (4 Σ_j φ_j σ_j(ω))    scaled phase function, 1/sr, h = (ω + ω′)/|ω + ω′|
//! ```
//!
//! ω and ω′ point away from the scattering point and are unit vectors in the frame of the volume. p is a density of ω′ given
//! ω; its integral is the albedo seen from ω, at most the largest a_j. σ_t(ω)·p(ω, ω′) is symmetric: a mixture of flakes is
//! reciprocal, which a sum of phase functions with constant weights is not.
//!
//! S is kept as its Cholesky factor, S = L Lᵀ. Then σ(ω) = |Lᵀω| and mᵀS⁻¹m = |L⁻¹m|² are sums of squares and √|S| is a
//! product of three numbers: nothing cancels, however flat the lobe is, and every factor is a valid S, quantised or not.

use std::f32::consts::FRAC_1_PI;

/// One SGGX lobe: a symmetric positive definite S as its Cholesky factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sggx {
    /// L, lower triangular, row by row: `xx`, `yx yy`, `zx zy zz`; the diagonal is positive.
    factor: [f32; 6],
}

/// One lobe of a voxel's flakes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlakeLobe {
    /// Share φ of the voxel's flake area.
    pub area: f32,
    /// The flakes' normals.
    pub shape: Sggx,
    /// Albedo a of these flakes, RGB in [0, 1].
    pub albedo: [f32; 3],
}

/// Smallest pivot of a factor over the root of the trace of S: eigenvalues of 1e-10, far under what inputs may have (1e-4)
/// and what six rounded numbers can say (1e-7).
const MIN_PIVOT: f64 = 1e-5;

/// Rounding of the six numbers of S, over its trace, by which a singular S may seem to have a negative pivot.
const ROUNDING: f64 = 1e-6;

impl Sggx {
    /// S = 1: flakes that show the same area to every viewer.
    pub const ISOTROPIC: Self = Self { factor: [1.0, 0.0, 1.0, 0.0, 0.0, 1.0] };

    /// The lobe of the matrix `s`, in the order xx yy zz xy xz yz.
    ///
    /// `None` where `s` is not finite, zero, or has a negative eigenvalue that rounding does not explain. A singular `s` gets
    /// the least pivots that keep its inverse finite.
    pub fn from_matrix(s: [f32; 6]) -> Option<Self> {
        Self::factorise(s.map(f64::from))
    }

    /// [`Sggx::from_matrix`] in double precision.
    fn factorise(s: [f64; 6]) -> Option<Self> {
        let [xx, yy, zz, xy, xz, yz] = s;
        let trace = xx + yy + zz;
        if !(trace.is_finite() && trace > 0.0 && s.iter().all(|value| value.is_finite())) {
            return None;
        }
        // A pivot that rounding made too small or negative is raised; a truly negative one is refused.
        let root = |pivot: f64| {
            let least = (MIN_PIVOT * MIN_PIVOT) * trace;
            (pivot > -ROUNDING * trace).then(|| pivot.max(least).sqrt())
        };
        let lxx = root(xx)?;
        let [lyx, lzx] = [xy / lxx, xz / lxx];
        let lyy = root(yy - lyx * lyx)?;
        let lzy = (yz - lyx * lzx) / lyy;
        let lzz = root(zz - lzx * lzx - lzy * lzy)?;
        Some(Self { factor: [lxx, lyx, lyy, lzx, lzy, lzz].map(|value| value as f32) })
    }

    /// The lobe with the Cholesky factor `factor`: xx, yx yy, zx zy zz, of which xx, yy and zz are greater than 0.
    #[inline]
    pub fn from_factor(factor: [f32; 6]) -> Self {
        debug_assert!(factor[0] > 0.0 && factor[2] > 0.0 && factor[5] > 0.0, "a positive diagonal: {factor:?}");
        Self { factor }
    }

    /// Fibres along `axis` (not zero), seen along which they show the area `along` > 0: S = 1 − (1 − along²)·axis axisᵀ.
    pub fn fibre(axis: [f32; 3], along: f32) -> Self {
        // In f64: along² may be as small as a rounding of 1.
        let axis = axis.map(f64::from);
        let less = (1.0 - f64::from(along) * f64::from(along)) / axis.iter().map(|value| value * value).sum::<f64>();
        let [x, y, z] = axis;
        let [xx, yy, zz] = axis.map(|value| 1.0 - less * value * value);
        Self::factorise([xx, yy, zz, -less * x * y, -less * x * z, -less * y * z]).unwrap_or(Self::ISOTROPIC)
    }

    /// The factor L: xx, yx yy, zx zy zz.
    #[inline]
    pub fn factor(&self) -> [f32; 6] {
        self.factor
    }

    /// S in the order xx yy zz xy xz yz.
    pub fn matrix(&self) -> [f32; 6] {
        let [xx, yx, yy, zx, zy, zz] = self.factor;
        [xx * xx, yx * yx + yy * yy, zx * zx + zy * zy + zz * zz, xx * yx, xx * zx, yx * zx + yy * zy]
    }

    /// L·v.
    #[inline]
    pub fn stretch(&self, v: [f32; 3]) -> [f32; 3] {
        let [xx, yx, yy, zx, zy, zz] = self.factor;
        [xx * v[0], yx * v[0] + yy * v[1], zx * v[0] + zy * v[1] + zz * v[2]]
    }

    /// Lᵀ·v, whose length for a unit vector is the projected area.
    #[inline]
    pub fn stretch_transposed(&self, v: [f32; 3]) -> [f32; 3] {
        let [xx, yx, yy, zx, zy, zz] = self.factor;
        [xx * v[0] + yx * v[1] + zx * v[2], yy * v[1] + zy * v[2], zz * v[2]]
    }

    /// σ(ω) = √(ωᵀSω), the flake area shown to the unit direction `w`; at most √λmax.
    #[inline]
    pub fn projected_area(&self, w: [f32; 3]) -> f32 {
        dot(self.stretch_transposed(w)).sqrt()
    }

    /// D(m), the density of flake normals at the direction of `m`, 1/sr; `m` is not zero and need not be of unit length.
    ///
    /// ∫ D(m) ⟨ω, m⟩ dm = σ(ω); for S = 1 it is 1/π everywhere, the sphere that shows unit area to every viewer.
    #[inline]
    pub fn density(&self, m: [f32; 3]) -> f32 {
        let [xx, yx, yy, zx, zy, zz] = self.factor;
        // L⁻¹m by forward substitution
        let a = m[0] / xx;
        let b = (m[1] - yx * a) / yy;
        let c = (m[2] - zx * a - zy * b) / zz;
        let q = dot(m) / dot([a, b, c]);
        q * q * FRAC_1_PI / (xx * yy * zz)
    }
}

/// Σ_j φ_j σ_j(ω): extinction over density.
#[inline]
pub fn projected_area(lobes: &[FlakeLobe], w: [f32; 3]) -> f32 {
    lobes.iter().map(|lobe| lobe.area * lobe.shape.projected_area(w)).sum()
}

/// Σ_j a_j φ_j σ_j(ω) f_j(ω → ω′) = Σ_j a_j φ_j D_j(h)/4: scattering from `w` to `wi` over density, RGB, 1/sr; symmetric.
#[inline]
pub fn scattering(lobes: &[FlakeLobe], w: [f32; 3], wi: [f32; 3]) -> [f32; 3] {
    let Some(h) = half_vector(w, wi) else { return [0.0; 3] };
    let mut sum = [0.0; 3];
    for lobe in lobes {
        let d = 0.25 * lobe.area * lobe.shape.density(h);
        (0..3).for_each(|c| sum[c] += lobe.albedo[c] * d);
    }
    sum
}

/// The scaled phase function p(ω, ω′), RGB, 1/sr: a density of `wi` given `w` times the albedo of the flakes that reflect.
#[inline]
pub fn phase(lobes: &[FlakeLobe], w: [f32; 3], wi: [f32; 3]) -> [f32; 3] {
    let area = projected_area(lobes, w);
    if area > 0.0 { scattering(lobes, w, wi).map(|value| value / area) } else { [0.0; 3] }
}

/// ω + ω′, the normal of the flakes that reflect one into the other; `None` for opposite directions, which any flake that is
/// seen edge-on connects: a set of no measure.
#[inline]
pub fn half_vector(w: [f32; 3], wi: [f32; 3]) -> Option<[f32; 3]> {
    let h = [w[0] + wi[0], w[1] + wi[1], w[2] + wi[2]];
    (dot(h) > f32::EPSILON * f32::EPSILON).then_some(h)
}

/// |v|².
#[inline]
fn dot(v: [f32; 3]) -> f32 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lookup::direction_of;

    /// Directions over the sphere, about evenly: an N × N grid on either hemisphere, each for the same solid angle.
    fn sphere(n: usize) -> impl Iterator<Item = [f32; 3]> {
        (0..2 * n * n).map(move |k| {
            let [i, j] = [k % n, k / n % n];
            let [x, y, z] = direction_of([(i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32]);
            [x, y, if k < n * n { z } else { -z }]
        })
    }

    fn unit(v: [f32; 3]) -> [f32; 3] {
        let length = dot(v).sqrt();
        v.map(|value| value / length)
    }

    fn lobes() -> Vec<FlakeLobe> {
        vec![
            FlakeLobe { area: 0.6, shape: Sggx::fibre(unit([1.0, 2.0, -0.5]), 0.3), albedo: [0.9, 0.2, 1.0] },
            FlakeLobe { area: 0.4, shape: Sggx::fibre(unit([-0.3, 0.2, 0.9]), 0.1), albedo: [0.1, 0.8, 1.0] },
        ]
    }

    #[test]
    fn matrix_and_factor_are_two_forms_of_one_lobe() {
        for along in [1.0, 0.3, 0.01, 0.001] {
            let axis = unit([0.5, -0.7, 0.2]);
            let lobe = Sggx::fibre(axis, along);
            assert!((lobe.projected_area(axis) - along).abs() < 2e-5 + 1e-3 * along, "{along}");
            let again = Sggx::from_matrix(lobe.matrix()).unwrap();
            for w in sphere(6) {
                // six rounded numbers hold an eigenvalue of 1e-6 to a tenth
                assert!((lobe.projected_area(w) - again.projected_area(w)).abs() < 3e-4, "{along}");
            }
        }
    }

    #[test]
    fn what_is_no_lobe_is_refused_and_a_singular_one_stays_finite() {
        for bad in [[0.0; 6], [f32::NAN; 6], [1.0, 1.0, -0.1, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.5, 0.0, 0.0]] {
            assert_eq!(Sggx::from_matrix(bad), None, "{bad:?}");
        }
        let flat = Sggx::from_matrix([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]).unwrap();
        let (d, area) = (flat.density([0.0, 0.0, 1.0]), flat.projected_area([1.0, 0.0, 0.0]));
        assert!(d.is_finite() && d > 0.0 && area > 0.0 && area < 1e-4, "{d} {area}");
    }

    #[test]
    fn the_area_that_the_normals_show_is_the_projected_area() {
        let n = 400;
        let solid_angle = 4.0 * std::f64::consts::PI / (2 * n * n) as f64;
        for lobe in lobes().iter().map(|lobe| lobe.shape).chain([Sggx::ISOTROPIC]) {
            for w in sphere(3) {
                let shown: f64 = sphere(n)
                    .map(|m| {
                        let cosine = (0..3).map(|k| m[k] * w[k]).sum::<f32>().max(0.0);
                        f64::from(lobe.density(m) * cosine) * solid_angle
                    })
                    .sum();
                // the midpoint rule over cells of a four-hundredth, lobes down to 0.1 wide
                assert!((shown - f64::from(lobe.projected_area(w))).abs() < 2e-4, "{shown} {lobe:?}");
            }
        }
    }

    #[test]
    fn scattering_is_reciprocal_and_the_phase_function_carries_the_albedo() {
        let mut white = lobes();
        white.iter_mut().for_each(|lobe| lobe.albedo = [1.0; 3]);
        let n = 500;
        let solid_angle = 4.0 * std::f64::consts::PI / (2 * n * n) as f64;
        for w in sphere(3) {
            for wi in sphere(3) {
                assert_eq!(scattering(&lobes(), w, wi), scattering(&lobes(), wi, w));
            }
            let total: f64 = sphere(n).map(|wi| f64::from(phase(&white, w, wi)[0]) * solid_angle).sum();
            // h sweeps the lobe twice as fast as m did above
            assert!((total - 1.0).abs() < 2e-3, "{total}");
            let seen = phase(&lobes(), w, [0.0, 1.0, 0.0]);
            assert!(seen.iter().all(|value| value.is_finite() && *value >= 0.0));
        }
        assert_eq!(phase(&lobes(), [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]), [0.0; 3]);
    }
}
