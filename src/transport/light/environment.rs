//! An environment map, sampled by its luminance.

use std::f64::consts::{PI, TAU};

use glam::Vec3;

use super::{LightSample, luminance};

/// An equirectangular environment map of constant texels.
///
/// Row 0 is the top. In the map's frame the direction (x, y, z) has the place
///
/// > u = ½ + atan2(x, −z)/2π, v = acos(y)/π
///
/// in units of the image: its centre column looks along −z, u = ¾ along +x. The map is turned by `rotation` about y,
/// right-handed (seen from above: counterclockwise), so that its centre looks along (−sin, 0, −cos)(rotation).
///
/// Radiance is constant over a texel, and a texel is proposed by luminance times solid angle: the density of a
/// direction is its luminance over the sum of all, whatever the size of the texels. Only y > 0 is proposed; a row that
/// the horizon divides is cut there. Structure that holds less than 2⁻²⁴ of the light of its row is finer than `u`
/// resolves.
#[derive(Clone, Debug)]
pub struct ImageLight {
    /// RGB, W/(m² sr), scaled, `[v][u]`.
    radiance: Vec<[f32; 3]>,
    size: [usize; 2],
    /// Radians about y.
    rotation: f64,
    /// The y of the upper rims of the rows above the horizon, and 0.
    rims: Vec<f64>,
    /// Share of the light in the rows up to and including each, `[v]`.
    rows: Vec<f64>,
    /// Share of a row's light in the texels up to and including each, `[v][u]`.
    columns: Vec<f64>,
    /// ∫ luminance dω over the upper hemisphere.
    total: f64,
    /// ∫ luminance · y dω over the upper hemisphere.
    strength: f64,
}

impl ImageLight {
    /// The map of `size[0]` × `size[1]` texels, `[v][u]`, linear RGB in W/(m² sr) once multiplied by `scale`.
    ///
    /// `rotation` is in radians about y, right-handed.
    ///
    /// # Panics
    /// If there are not `size[0]·size[1]` texels, or none, or one is negative or not finite, as is `scale`: `io` and
    /// the manifest refuse such input.
    pub fn new(texels: Vec<[f32; 3]>, size: [usize; 2], scale: f32, rotation: f64) -> Self {
        assert!(texels.len() == size[0] * size[1] && !texels.is_empty(), "one colour a texel");
        let mut radiance = texels;
        radiance.iter_mut().flatten().for_each(|value| *value *= scale);
        assert!(radiance.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0), "finite radiance of at least 0");
        let upper = size[1].div_ceil(2);
        // cos of a quarter turn is no exact 0, and the cut row goes on below it.
        let rim = |v: usize| if 2 * v >= size[1] { 0.0 } else { (PI * v as f64 / size[1] as f64).cos() };
        let rims: Vec<f64> = (0..=upper).map(rim).collect();
        let mut columns = Vec::with_capacity(upper * size[0]);
        let mut row_light = Vec::with_capacity(upper);
        for (v, row) in radiance.chunks_exact(size[0]).take(upper).enumerate() {
            let mean = push_shares(&mut columns, row.iter().map(|&rgb| luminance(rgb))) / size[0] as f64;
            row_light.push(mean * TAU * (rims[v] - rims[v + 1]));
        }
        // ∫ y dω over a row is its solid angle times the mean of its rims.
        let strength = row_light.iter().enumerate().map(|(v, light)| light * 0.5 * (rims[v] + rims[v + 1])).sum();
        let mut rows = Vec::with_capacity(upper);
        let total = push_shares(&mut rows, row_light.iter().copied());
        Self { radiance, size, rotation, rims, rows, columns, total, strength }
    }

    /// Radiance from a direction of the world, of its texel.
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        self.radiance[self.texel(direction)]
    }

    /// A direction above the horizon by luminance; `None` where the upper half is black.
    pub(super) fn sample(&self, u: [f32; 2]) -> Option<LightSample> {
        let width = self.size[0];
        let (row, down) = draw(&self.rows, f64::from(u[1]))?;
        let (column, right) = draw(&self.columns[row * width..][..width], f64::from(u[0]))?;
        let y = self.rims[row] + down * (self.rims[row + 1] - self.rims[row]);
        let azimuth = TAU * ((column as f64 + right) / width as f64 - 0.5) - self.rotation;
        let (sin, cos) = azimuth.sin_cos();
        let across = (1.0 - y * y).sqrt();
        let wi = Vec3::new((across * sin) as f32, y as f32, (-across * cos) as f32);
        let radiance = self.radiance[row * width + column];
        let pdf = (luminance(radiance) / self.total) as f32;
        Some(LightSample { wi, distance: f64::INFINITY, radiance, pdf, is_delta: false })
    }

    /// Density of [`ImageLight::sample`], 1/sr: luminance over its sum above the horizon, 0 below.
    pub(super) fn pdf(&self, direction: Vec3) -> f32 {
        if direction.y <= 0.0 || self.total == 0.0 {
            return 0.0;
        }
        (luminance(self.radiance(direction)) / self.total) as f32
    }

    /// Luminance of the irradiance on the base plane.
    pub(super) fn strength(&self) -> f64 {
        self.strength
    }

    /// Index of the texel that a direction of the world lies in.
    fn texel(&self, direction: Vec3) -> usize {
        let [width, height] = self.size;
        let [x, y, z] = direction.as_dvec3().to_array();
        let turn = 0.5 + (x.atan2(-z) + self.rotation) / TAU;
        // The clamp and the minima absorb a length, a turn or a polar angle that rounds beyond the last texel.
        let column = ((turn - turn.floor()) * width as f64) as usize;
        let row = (y.clamp(-1.0, 1.0).acos() / PI * height as f64) as usize;
        row.min(height - 1) * width + column.min(width - 1)
    }
}

/// Appends the shares of the total that the values up to and including each make up, and returns the total.
///
/// Sums in f64 in index order. The last share is 1 exactly, unless all values are 0: then all are 0.
fn push_shares(shares: &mut Vec<f64>, values: impl Iterator<Item = f64>) -> f64 {
    let start = shares.len();
    let mut sum = 0.0;
    shares.extend(values.map(|value| {
        sum += value;
        sum
    }));
    if sum > 0.0 {
        shares[start..].iter_mut().for_each(|share| *share /= sum);
    }
    sum
}

/// The interval of cumulative `shares` that `u` ∈ [0, 1) lies in, never an empty one, and its place in it, in [0, 1).
fn draw(shares: &[f64], u: f64) -> Option<(usize, f64)> {
    let index = shares.partition_point(|&share| share <= u);
    let end = *shares.get(index)?;
    let start = if index == 0 { 0.0 } else { shares[index - 1] };
    // Absorbs the rounding of the quotient up to 1.
    Some((index, ((u - start) / (end - start)).min(1.0 - f64::EPSILON / 2.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map whose texel (u, v) has the red value v·width + u and green 1.
    fn numbered(size: [usize; 2], rotation: f64) -> ImageLight {
        let texels = (0..size[0] * size[1]).map(|i| [i as f32, 1.0, 0.0]).collect();
        ImageLight::new(texels, size, 1.0, rotation)
    }

    #[test]
    fn axes_of_the_world_lie_where_the_formulas_say() {
        let light = numbered([8, 4], 0.0);
        let slight = 0.1; // off the borders of texels
        for (direction, [u, v]) in [
            (Vec3::new(slight, slight, -1.0), [4, 1]),
            (Vec3::new(-slight, slight, -1.0), [3, 1]),
            (Vec3::new(1.0, -slight, slight), [6, 2]),
            (Vec3::new(-1.0, -slight, -slight), [2, 2]),
            (Vec3::new(slight, slight, 1.0), [7, 1]),
            (Vec3::new(-slight, slight, 1.0), [0, 1]),
            (Vec3::new(slight, 1.0, -0.01), [5, 0]),
            (Vec3::new(slight, -1.0, -0.01), [5, 3]),
        ] {
            assert_eq!(light.radiance(direction.normalize())[0], (v * 8 + u) as f32, "{direction}");
        }
    }

    #[test]
    fn a_quarter_turn_brings_the_centre_column_to_minus_x() {
        let [plain, turned] = [0.0, PI / 2.0].map(|rotation| numbered([8, 4], rotation));
        for k in 0..8 {
            let direction = Vec3::new((k as f32 + 0.3).sin(), 0.4, (k as f32 + 0.3).cos()).normalize();
            // A right-handed quarter turn about y takes (x, z) to (z, −x).
            let image = Vec3::new(direction.z, direction.y, -direction.x);
            assert_eq!(plain.radiance(direction), turned.radiance(image));
        }
        assert_eq!(turned.radiance(Vec3::new(-1.0, 0.1, -0.1).normalize())[0], 12.0);
    }

    #[test]
    fn a_sample_is_what_a_look_along_it_finds() {
        let stream = crate::math::rng::Stream::new(11, 0);
        for size in [[8, 4], [9, 5], [1, 1], [64, 33]] {
            let light = numbered(size, 0.7);
            // A sample within an f32's rounding of a border may look into the neighbour.
            let off = (0..4000)
                .map(|i| light.sample(stream.uniform_pair(i)).unwrap())
                .inspect(|s| assert!(s.wi.y > 0.0 && s.wi.is_normalized() && s.pdf > 0.0, "{s:?}"))
                .filter(|s| light.radiance(s.wi) != s.radiance || light.pdf(s.wi) != s.pdf);
            assert!(off.count() <= 2, "{size:?}");
        }
    }

    #[test]
    fn texels_without_light_are_never_proposed() {
        let texels = (0..72).map(|i| [0.0, 0.0, if i % 7 == 3 { 1e-30 } else { 0.0 }]).collect();
        let light = ImageLight::new(texels, [12, 6], 1.0, 0.0);
        let ends = [0.0, 1.0 - f32::EPSILON / 2.0];
        let stream = crate::math::rng::Stream::new(12, 0);
        let us = ends.iter().flat_map(|&a| ends.map(|b| [a, b])).chain((0..1000).map(|i| stream.uniform_pair(i)));
        for sample in us.map(|u| light.sample(u).unwrap()) {
            assert!(sample.radiance[2] == 1e-30 && sample.pdf.is_finite() && sample.pdf > 0.0);
        }
        let black = ImageLight::new(vec![[0.0; 3]; 8], [4, 2], 1.0, 0.0);
        assert_eq!((black.sample([0.5, 0.5]), black.pdf(Vec3::Y)), (None, 0.0));
    }

    #[test]
    fn light_below_the_horizon_is_seen_and_not_proposed() {
        let below = |i: usize| if i >= 32 { [5.0; 3] } else { [0.0; 3] };
        let light = ImageLight::new((0..64).map(below).collect(), [8, 8], 2.0, 0.0);
        assert_eq!(light.radiance(-Vec3::Y), [10.0; 3]);
        assert_eq!((light.sample([0.3, 0.6]), light.pdf(-Vec3::Y), light.strength()), (None, 0.0, 0.0));
    }

    #[test]
    fn the_density_integrates_to_one_over_the_upper_hemisphere() {
        for size in [[8, 4], [9, 5], [6, 3]] {
            let light = numbered(size, 0.3);
            let steps = [60 * size[0], 60 * size[1]];
            let mut sum = 0.0;
            for i in 0..steps[0] * steps[1] {
                // Equal steps in azimuth and angle from the pole; sub-texels never straddle a texel, or the horizon.
                let [azimuth, polar] = [
                    TAU * ((i % steps[0]) as f64 + 0.5) / steps[0] as f64,
                    PI * ((i / steps[0]) as f64 + 0.5) / steps[1] as f64,
                ];
                let azimuth = azimuth - light.rotation;
                let direction =
                    glam::DVec3::new(polar.sin() * azimuth.sin(), polar.cos(), -polar.sin() * azimuth.cos());
                let solid_angle = TAU / steps[0] as f64 * PI / steps[1] as f64 * polar.sin();
                sum += f64::from(light.pdf(direction.as_vec3())) * solid_angle;
            }
            // The midpoint rule's error for sinθ is (step)²/24.
            assert!((sum - 1.0).abs() < 1e-4, "{size:?}: {sum}");
        }
    }
}
