//! Light that a point of a surface, fine or coarse, receives from the rest of it, by exact ray casts (4.15–4.17).
//!
//! The path starts at a point p, leaves it towards ω1 and goes on as long as it meets the surface. At each of its further
//! vertices q every direction of a list is tried as the light's: unit radiance from ωi, met with its cosine at q and not
//! hidden by exact ray casts. F of two and more reflections is then the mean over p, and over ω1, of
//!
//! ```text
//! ½ (b(ωo) a(ωi) + b(ωi) a(ωo)),   b(ω) = f(ω1, ω) ⟨n_p, ω⟩⟨n_p, ω1⟩/⟨n_p, ωg⟩ V(p, ω)/p(ω1)
//! ```
//!
//! where a(ωi) is what comes back from ω1 and p(ω1) its density. Directions are unit, point away from the surface and live
//! in the frame of the base plane.

use glam::Vec3;

use crate::geometry::{HeightTracer, SurfacePoint};
use crate::material::{Brdf, BrdfSample};
use crate::math::frame::Frame;
use crate::math::rng::Stream;
use crate::math::warp;

use super::effective::PatchPoint;
use formats::level_brdf::{BoundBrdf, LevelBrdf, LevelHit};

/// What a surface reflects at its points.
pub trait Reflector {
    /// Its BRDF at a place for a viewer.
    type Bound<'b>: BoundReflector
    where
        Self: 'b;

    /// Share of first directions that follow the cosine; the others follow the BRDF as a random direction of the list sees
    /// it, which asks for the BRDF as all of them see it.
    const COSINE_SHARE: f32;

    /// The BRDF at `point`, whose unit normal is `normal`, for a viewer at `wo`; reciprocal.
    fn at(&self, point: SurfacePoint, normal: Vec3, wo: Vec3) -> Self::Bound<'_>;
}

/// A BRDF at a place for a viewer.
pub trait BoundReflector {
    /// f for light from `wi`, 1/sr, RGB, without cosine; 0 where light or viewer is not above the horizon of the normal.
    fn eval(&self, wi: Vec3) -> [f32; 3];

    /// A direction to go on, from three uniform numbers, and its density, 1/sr.
    fn sample(&self, u: [f32; 3]) -> Option<BrdfSample>;

    /// The density of [`Self::sample`] at `wi`.
    fn pdf(&self, wi: Vec3) -> f32;
}

/// A base BRDF with a colour map.
#[derive(Clone, Copy, Debug)]
pub struct BaseReflector<'a> {
    /// The BRDF.
    pub brdf: &'a Brdf,
    /// Its colour factors, `[v][u]`.
    pub color: Option<&'a [[f32; 3]]>,
    /// Texels along u.
    pub width: usize,
}

/// A base BRDF, a normal and a viewer.
#[derive(Clone, Copy, Debug)]
pub struct BoundBase {
    brdf: Brdf,
    normal: Vec3,
    wo: Vec3,
}

impl Reflector for BaseReflector<'_> {
    type Bound<'b>
        = BoundBase
    where
        Self: 'b;

    // narrow lobes are found by their own samples
    const COSINE_SHARE: f32 = 0.5;

    fn at(&self, point: SurfacePoint, normal: Vec3, wo: Vec3) -> BoundBase {
        let texel = || point.cell[1] * self.width + point.cell[0];
        BoundBase { brdf: self.color.map_or(*self.brdf, |color| self.brdf.tinted(color[texel()])), normal, wo }
    }
}

impl BoundReflector for BoundBase {
    fn eval(&self, wi: Vec3) -> [f32; 3] {
        self.brdf.eval(self.normal, wi, self.wo)
    }

    fn sample(&self, u: [f32; 3]) -> Option<BrdfSample> {
        self.brdf.sample(self.normal, self.wo, u)
    }

    fn pdf(&self, wi: Vec3) -> f32 {
        self.brdf.pdf(self.normal, wi, self.wo)
    }
}

/// f_low of a level on its coarse surface, without the additive term: light that comes from inside the relief does not
/// meet it.
#[derive(Clone, Copy, Debug)]
pub struct LevelReflector<'a> {
    /// The level's BRDF.
    pub level: &'a LevelBrdf<'a>,
    /// Its cells along u and v.
    pub cells: [usize; 2],
}

/// f_low at a place for a viewer.
#[derive(Clone, Debug)]
pub struct BoundLevel<'a> {
    brdf: BoundBrdf<'a>,
    normal: Vec3,
}

impl Reflector for LevelReflector<'_> {
    type Bound<'b>
        = BoundLevel<'b>
    where
        Self: 'b;

    // the normals of a cell make every f_low wide
    const COSINE_SHARE: f32 = 1.0;

    fn at(&self, point: SurfacePoint, normal: Vec3, wo: Vec3) -> BoundLevel<'_> {
        let x = [0, 1].map(|k| (point.cell[k] as f32 + point.st[k]) / self.cells[k] as f32);
        // the last cell's end belongs to it: 1 − ε/2 is the largest number below 1
        let x = x.map(|x| x.min(1.0 - 0.5 * f32::EPSILON));
        let hit = LevelHit { x, n_c: normal.to_array(), tilt: [0.0; 2] };
        BoundLevel { brdf: self.level.at(&hit, wo.to_array()), normal }
    }
}

impl BoundReflector for BoundLevel<'_> {
    fn eval(&self, wi: Vec3) -> [f32; 3] {
        if self.normal.dot(wi) <= 0.0 {
            return [0.0; 3];
        }
        self.brdf.eval(wi.to_array())
    }

    fn sample(&self, u: [f32; 3]) -> Option<BrdfSample> {
        let sample = self.brdf.sample(u)?;
        Some(BrdfSample { wi: Vec3::from(sample.wi), value: sample.f, pdf: sample.pdf })
    }

    fn pdf(&self, wi: Vec3) -> f32 {
        self.brdf.pdf(wi.to_array())
    }
}

/// One path and what it carries for every direction of a list.
#[derive(Clone, Debug)]
pub struct Bounce {
    /// a(ω): what comes back to p for light from each direction.
    pub light: Vec<[f32; 3]>,
    /// b(ω): what p makes of it towards each direction.
    pub view: Vec<[f32; 3]>,
}

impl Bounce {
    /// The path's share of F for the pair (i, o) of directions, RGB.
    pub fn reflected(&self, i: usize, o: usize) -> [f64; 3] {
        [0, 1, 2].map(|c| {
            let [there, back] = [(i, o), (o, i)].map(|(i, o)| f64::from(self.light[i][c]) * f64::from(self.view[o][c]));
            0.5 * (there + back)
        })
    }
}

/// Least chance that a path goes on.
const LEAST_SURVIVAL: f32 = 0.05;

/// A path has ended long before, unless a level reflects more than it receives.
const MOST_BOUNCES: u64 = 1024;

/// A path from `point`; `None` where it leaves the surface at once, and where no direction sees the point.
pub fn bounce<R: Reflector>(
    tracer: &HeightTracer<'_>,
    reflector: &R,
    point: &PatchPoint<'_>,
    directions: &[Vec3],
    stream: Stream,
) -> Option<Bounce> {
    let seen: Vec<usize> = (0..directions.len()).filter(|&k| point.sees(k)).collect();
    let viewer = *seen.get((stream.uniform(0) * seen.len() as f32) as usize)?;
    let (start, normal) = (point.point, point.normal);
    let u: [f32; 4] = std::array::from_fn(|k| stream.uniform(1 + k as u64));
    let first = if u[3] < R::COSINE_SHARE {
        Frame::around(normal).to_outer(warp::cosine_hemisphere([u[0], u[1]]))
    } else {
        reflector.at(start, normal, directions[viewer]).sample([u[0], u[1], u[2]])?.wi
    };
    let light = light_along(tracer, reflector, (start, first), directions, stream.at(8))?;
    let cosine = normal.dot(first);
    let mut density = R::COSINE_SHARE * warp::cosine_hemisphere_pdf(cosine);
    if R::COSINE_SHARE < 1.0 {
        let lobes: f32 = seen.iter().map(|&k| reflector.at(start, normal, directions[k]).pdf(first)).sum();
        density += (1.0 - R::COSINE_SHARE) * lobes / seen.len() as f32;
    }
    // a direction along the surface, to rounding
    if density <= 0.0 {
        return None;
    }
    let back = reflector.at(start, normal, first);
    let mut view = vec![[0.0; 3]; directions.len()];
    for &k in &seen {
        let scale = point.shown_area(directions[k]) * cosine / density;
        view[k] = back.eval(directions[k]).map(|f| f * scale);
    }
    Some(Bounce { light, view })
}

/// a(ω) of every direction for what comes back along a ray; `None` where the ray meets nothing.
fn light_along(
    tracer: &HeightTracer<'_>,
    reflector: &impl Reflector,
    (mut point, mut towards): (SurfacePoint, Vec3),
    directions: &[Vec3],
    stream: Stream,
) -> Option<Vec<[f32; 3]>> {
    let mut light = None;
    let mut weight = [1.0_f32; 3];
    for bounce in 0..MOST_BOUNCES {
        let Some(hit) = tracer.intersect_from(point, towards) else { break };
        if hit.normal.dot(towards) >= 0.0 {
            break;
        }
        let brdf = reflector.at(hit.point, hit.normal, -towards);
        let sum = light.get_or_insert_with(|| vec![[0.0_f32; 3]; directions.len()]);
        for (sum, &wi) in sum.iter_mut().zip(directions) {
            let cosine = hit.normal.dot(wi);
            if cosine > 0.0 && !tracer.occluded(hit.point, wi) {
                let f = brdf.eval(wi);
                (0..3).for_each(|c| sum[c] += weight[c] * f[c] * cosine);
            }
        }
        let random = |k: u64| stream.uniform(4 * bounce + k);
        let Some(next) = brdf.sample([random(0), random(1), random(2)]) else {
            break;
        };
        let cosine = hit.normal.dot(next.wi) / next.pdf;
        let after: [f32; 3] = std::array::from_fn(|c| weight[c] * next.value[c] * cosine);
        let survival = after.iter().fold(0.0_f32, |a, &b| a.max(b)).clamp(LEAST_SURVIVAL, 1.0);
        if random(3) >= survival {
            break;
        }
        weight = after.map(|w| w / survival);
        (point, towards) = (hit.point, next.wi);
    }
    light
}
