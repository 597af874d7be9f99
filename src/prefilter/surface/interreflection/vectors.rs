//! What a path's vertices answer to all directions of the table.

use super::Scene;
use super::paths::{COSINE_SHARE, Path, brdf_of, masks};
use crate::material::Brdf;
use crate::math::simd;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Lanes that rows are padded to.
pub(super) const LANES: usize = 16;

/// a and b of some paths: `[channel][path][direction]`, directions padded to a multiple of [`LANES`].
pub(super) struct Vectors {
    /// What the further vertices reflect of every light.
    pub(super) light: Vec<Vec<f32>>,
    /// What the first vertex reflects to every viewer.
    pub(super) view: Vec<Vec<f32>>,
}

impl Vectors {
    /// Of these paths.
    pub(super) fn new(scene: &Scene<'_>, paths: &[Path<'_>]) -> Self {
        let row = scene.directions.len().next_multiple_of(LANES);
        let empty = || vec![vec![0.0; paths.len() * row]; scene.channels()];
        let mut vectors = Self { light: empty(), view: empty() };
        let places: Vec<usize> =
            paths.iter().flat_map(|path| path.vertices.iter().map(|vertex| vertex.place)).collect();
        let masks = masks(scene, &places);
        let mut masks = masks.iter();
        let mut lobes = Lobes::new(scene.directions.len());
        for (k, path) in paths.iter().enumerate() {
            let at = k * row..k * row + scene.directions.len();
            for vertex in &path.vertices {
                let brdf = brdf_of(scene, vertex.texel);
                lobes.evaluate(scene, &brdf, vertex.normal, vertex.back, masks.next().expect("a mask a vertex"));
                for (channel, light) in vectors.light.iter_mut().enumerate() {
                    lobes.add(&brdf, channel, vertex.weight[channel], &mut light[at.clone()]);
                }
            }
            let start = path.start;
            let brdf = brdf_of(scene, start.texel);
            lobes.evaluate(scene, &brdf, start.normal, path.direction, &start.mask);
            let cosine = start.normal.dot(path.direction);
            let weight = start.area * cosine / lobes.density(&brdf, cosine);
            for (channel, view) in vectors.view.iter_mut().enumerate() {
                lobes.add(&brdf, channel, weight, &mut view[at.clone()]);
            }
        }
        vectors.thin_out(row, paths);
        vectors
    }

    /// Russian roulette: a path that brings less than the mean survives in proportion, and then brings the mean.
    ///
    /// The product costs the same for every path, and where lobes are narrow most bring next to nothing.
    fn thin_out(&mut self, row: usize, paths: &[Path<'_>]) {
        let sum = |table: &[Vec<f32>], k: usize| {
            table.iter().map(|values| values[k * row..][..row].iter().sum::<f32>()).sum::<f32>()
        };
        let brought: Vec<f32> = (0..paths.len()).map(|k| sum(&self.light, k) * sum(&self.view, k)).collect();
        let mean = brought.iter().sum::<f32>() / brought.len().max(1) as f32;
        let mut kept = 0;
        for (k, (path, &brought)) in paths.iter().zip(&brought).enumerate() {
            let survival = brought / mean;
            if path.start.roulette() * mean >= brought {
                continue;
            }
            for table in [&mut self.light, &mut self.view] {
                table.iter_mut().for_each(|values| values.copy_within(k * row..(k + 1) * row, kept * row));
            }
            if survival < 1.0 {
                self.view.iter_mut().flat_map(|view| &mut view[kept * row..][..row]).for_each(|b| *b /= survival);
            }
            kept += 1;
        }
        self.light.iter_mut().chain(&mut self.view).for_each(|values| values.truncate(kept * row));
    }
}

/// One vertex and one direction, against all directions of the table.
struct Lobes {
    /// ⟨n, ω⟩ V(ω).
    cosine: Vec<f32>,
    /// The conductor's D·G/(4 cos cos), times that cosine.
    specular: Vec<f32>,
    /// Schlick's (1 − ω·h)⁵.
    schlick: Vec<f32>,
    /// Density of the vertex's direction, drawn for the viewer ω by visible normals.
    density: Vec<f32>,
}

impl Lobes {
    fn new(directions: usize) -> Self {
        let [cosine, specular, schlick, density] = std::array::from_fn(|_| vec![0.0; directions]);
        Self { cosine, specular, schlick, density }
    }

    /// Evaluates the parts of `brdf` between `fixed` and every direction of `mask`.
    fn evaluate(&mut self, scene: &Scene<'_>, brdf: &Brdf, normal: Vec3, fixed: Vec3, mask: &[u64]) {
        simd::run(Evaluate { lobes: self, scene, brdf, normal, fixed, mask });
    }

    /// Adds f·cosine·`weight` of one channel to `out`.
    fn add(&self, brdf: &Brdf, channel: usize, weight: f32, out: &mut [f32]) {
        let diffuse = weight * brdf.diffuse[channel] * FRAC_1_PI;
        if diffuse != 0.0 {
            out.iter_mut().zip(&self.cosine).for_each(|(out, cosine)| *out += diffuse * cosine);
        }
        if let Some(conductor) = brdf.specular {
            let f0 = conductor.f0[channel];
            for ((out, specular), schlick) in out.iter_mut().zip(&self.specular).zip(&self.schlick) {
                *out += weight * specular * (f0 + (1.0 - f0) * schlick);
            }
        }
    }

    /// Density of the first direction, at the angle `cosine` to the normal.
    fn density(&self, brdf: &Brdf, cosine: f32) -> f32 {
        let by_cosine = cosine * FRAC_1_PI;
        if brdf.specular.is_none() {
            return by_cosine;
        }
        let seen = self.cosine.iter().filter(|&&cosine| cosine > 0.0).count().max(1);
        let by_lobes = self.density.iter().sum::<f32>() / seen as f32;
        COSINE_SHARE * by_cosine + (1.0 - COSINE_SHARE) * by_lobes
    }
}

struct Evaluate<'a> {
    lobes: &'a mut Lobes,
    scene: &'a Scene<'a>,
    brdf: &'a Brdf,
    normal: Vec3,
    fixed: Vec3,
    mask: &'a [u64],
}

impl simd::Kernel for Evaluate<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.scene.directions.len();
        let [x, y, z] = &self.scene.directions.xyz;
        let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
        let normal = self.normal;
        let cosine = &mut self.lobes.cosine[..n];
        for (k, cosine) in cosine.iter_mut().enumerate() {
            let seen = (self.mask[k / 64] >> (k % 64) & 1) as f32;
            *cosine = seen * (normal.x * x[k] + normal.y * y[k] + normal.z * z[k]).max(0.0);
        }
        let Some(conductor) = self.brdf.specular else { return };
        let alpha2 = conductor.alpha * conductor.alpha;
        let fixed = self.fixed;
        let own = normal.dot(fixed);
        let root = |cosine: f32| (alpha2 + (1.0 - alpha2) * cosine * cosine).sqrt();
        let own_root = root(own);
        let (specular, schlick) = (&mut self.lobes.specular[..n], &mut self.lobes.schlick[..n]);
        let density = &mut self.lobes.density[..n];
        for k in 0..n {
            let (hx, hy, hz) = (fixed.x + x[k], fixed.y + y[k], fixed.z + z[k]);
            // |ω + ω1|² = 2(1 + ω·ω1); opposite directions have no half vector and no cosine of both
            let length2 = (hx * hx + hy * hy + hz * hz).max(1e-12);
            let inverse = 1.0 / length2.sqrt();
            let cos_h = (normal.x * hx + normal.y * hy + normal.z * hz) * inverse;
            let cos_d = 0.5 * length2 * inverse;
            let base = 1.0 - (1.0 - alpha2) * cos_h * cos_h;
            let d = alpha2 * FRAC_1_PI / (base * base);
            let (c, r) = (cosine[k], root(cosine[k]));
            let seen = if c > 0.0 { 1.0 } else { 0.0 };
            // D/(2 (c1 √o + co √1)), times the cosine of the table's direction; 1e-20 for c = 0
            specular[k] = d * 0.5 * c / (c * own_root + own * r + 1e-20);
            density[k] = seen * 0.25 * d / (0.5 * (c + r));
            let m = (1.0 - cos_d).max(0.0);
            schlick[k] = m * m * m * m * m;
        }
    }
}
