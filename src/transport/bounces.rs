//! Light that a point of a surface receives from the rest of it, by exact ray casts (4.15–4.17).
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

/// What a surface reflects at its points.
pub trait Reflector {
    /// f for light from `wi` seen from `wo`, 1/sr, RGB, without cosine; 0 where either is not above the horizon of `normal`.
    fn eval(&self, point: SurfacePoint, normal: Vec3, wi: Vec3, wo: Vec3) -> [f32; 3];

    /// A direction to go on from `wo`, from three uniform numbers, and its density, 1/sr.
    fn sample(&self, point: SurfacePoint, normal: Vec3, wo: Vec3, u: [f32; 3]) -> Option<BrdfSample>;

    /// The density of [`Self::sample`] at `wi`.
    fn pdf(&self, point: SurfacePoint, normal: Vec3, wi: Vec3, wo: Vec3) -> f32;
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

impl BaseReflector<'_> {
    fn at(&self, point: SurfacePoint) -> Brdf {
        self.color.map_or(*self.brdf, |color| self.brdf.tinted(color[point.cell[1] * self.width + point.cell[0]]))
    }
}

impl Reflector for BaseReflector<'_> {
    fn eval(&self, point: SurfacePoint, normal: Vec3, wi: Vec3, wo: Vec3) -> [f32; 3] {
        self.at(point).eval(normal, wi, wo)
    }

    fn sample(&self, point: SurfacePoint, normal: Vec3, wo: Vec3, u: [f32; 3]) -> Option<BrdfSample> {
        self.at(point).sample(normal, wo, u)
    }

    fn pdf(&self, point: SurfacePoint, normal: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        self.at(point).pdf(normal, wi, wo)
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

/// Share of first directions that follow the cosine; the others follow the BRDF as a random direction of the list sees it.
const COSINE_SHARE: f32 = 0.5;

/// Least chance that a path goes on.
const LEAST_SURVIVAL: f32 = 0.05;

/// A path from `point`; `None` where it leaves the surface at once, and where no direction sees the point.
pub fn bounce(
    tracer: &HeightTracer<'_>,
    reflector: &impl Reflector,
    point: &PatchPoint<'_>,
    directions: &[Vec3],
    stream: Stream,
) -> Option<Bounce> {
    let seen: Vec<usize> = (0..directions.len()).filter(|&k| point.sees(k)).collect();
    let viewer = *seen.get((stream.uniform(0) * seen.len() as f32) as usize)?;
    let (start, normal) = (point.point, point.normal);
    let u: [f32; 4] = std::array::from_fn(|k| stream.uniform(1 + k as u64));
    let first = if u[3] < COSINE_SHARE {
        Frame::around(normal).to_outer(warp::cosine_hemisphere([u[0], u[1]]))
    } else {
        reflector.sample(start, normal, directions[viewer], [u[0], u[1], u[2]])?.wi
    };
    let light = light_along(tracer, reflector, (start, first), directions, stream.at(8))?;
    let cosine = normal.dot(first);
    let lobes: f32 = seen.iter().map(|&k| reflector.pdf(start, normal, first, directions[k])).sum();
    let density = COSINE_SHARE * warp::cosine_hemisphere_pdf(cosine) + (1.0 - COSINE_SHARE) * lobes / seen.len() as f32;
    let mut view = vec![[0.0; 3]; directions.len()];
    for &k in &seen {
        let scale = point.shown_area(directions[k]) * cosine / density;
        view[k] = reflector.eval(start, normal, first, directions[k]).map(|f| f * scale);
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
    let mut dimension = 0;
    while let Some(hit) = tracer.intersect_from(point, towards) {
        if hit.normal.dot(towards) >= 0.0 {
            break;
        }
        let sum = light.get_or_insert_with(|| vec![[0.0_f32; 3]; directions.len()]);
        for (sum, &wi) in sum.iter_mut().zip(directions) {
            let cosine = hit.normal.dot(wi);
            if cosine > 0.0 && !tracer.occluded(hit.point, wi) {
                let f = reflector.eval(hit.point, hit.normal, wi, -towards);
                (0..3).for_each(|c| sum[c] += weight[c] * f[c] * cosine);
            }
        }
        let random = |k: u64| stream.uniform(dimension + k);
        let Some(next) = reflector.sample(hit.point, hit.normal, -towards, [random(0), random(1), random(2)]) else {
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
        dimension += 4;
    }
    light
}
