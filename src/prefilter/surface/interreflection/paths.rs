//! The paths: where they start, how they go on, and the vertices that they leave.

use super::super::splits::Part;
use super::Scene;
use crate::geometry::SurfacePoint;
use crate::material::Brdf;
use crate::math::frame::Frame;
use crate::math::rng::Stream;
use crate::math::warp;
use glam::Vec3;
use std::ops::Range;

/// Words of a mask of directions.
pub(super) type Mask = Vec<u64>;

/// A path's first vertex: the middle of a texel, or a part of a steep one.
pub(super) struct Start {
    /// Where it is.
    point: SurfacePoint,
    /// Row-major texel.
    pub(super) texel: usize,
    /// Unit normal.
    pub(super) normal: Vec3,
    /// Area of the patch per base area: what a start stands for.
    pub(super) area: f32,
    /// Directions that it sees.
    pub(super) mask: Mask,
    /// Two numbers for the first direction.
    u: [f32; 2],
    /// Random numbers of the rest of the path.
    stream: Stream,
}

/// A further vertex, which light reaches.
pub(super) struct Vertex {
    /// The place whose visibility it has.
    pub(super) place: usize,
    /// Row-major texel.
    pub(super) texel: usize,
    /// Unit normal.
    pub(super) normal: Vec3,
    /// Unit direction to the vertex before.
    pub(super) back: Vec3,
    /// Throughput from the first vertex's direction on.
    pub(super) weight: [f32; 3],
}

/// A path that met the surface.
pub(super) struct Path<'a> {
    /// Its first vertex.
    pub(super) start: &'a Start,
    /// Unit direction from there.
    pub(super) direction: Vec3,
    /// Its further vertices, at least one.
    pub(super) vertices: Vec<Vertex>,
}

/// Share of first directions that follow the cosine where there is a specular part; the others follow its lobes.
pub(super) const COSINE_SHARE: f32 = 0.5;

/// 1/φ and its powers, φ⁵ = φ + 1: the four-dimensional sequence of M. Roberts, by multiples of which points are laid.
const R4: [f64; 4] = [0.856_674_883_854_502_9, 0.733_891_856_627_126, 0.628_706_721_033_712_4, 0.538_597_257_223_612_8];

/// Streams of [`Stream`] used here, one a patch: none that the measurement of errors uses.
const STREAM: u64 = 1 << 42;

/// Index of [`Start::roulette`] in the path's numbers, beyond those of any bounce.
const ROULETTE: u64 = 1 << 19;

/// Least chance that a path goes on: even a black one would end after a few bounces.
const LEAST_SURVIVAL: f32 = 0.05;

impl Start {
    /// The starts of the rays of these numbers in a patch.
    pub(super) fn of_patch(scene: &Scene<'_>, patch: usize, rays: Range<usize>, seed: u64) -> Vec<Self> {
        let width = scene.fine.heights.size()[0];
        let stream = Stream::new(seed, STREAM + patch as u64);
        let shift: [f64; 4] = std::array::from_fn(|k| f64::from(stream.uniform(k as u64)));
        let splits = scene.splits;
        let places: Vec<usize> = rays
            .clone()
            .map(|ray| {
                let x = [0, 1].map(|k| (shift[k] + (ray as f64 + 1.0) * R4[k]).fract());
                scene.areas[patch].place(&scene.fine.heights, splits, x)
            })
            .collect();
        rays.zip(&places)
            .zip(masks(scene, &places))
            .map(|((ray, &place), mask)| {
                let Part { texel, st, .. } = splits.place(place);
                let texel = texel as usize;
                let [sx, sy] = splits.slope(&scene.fine.heights, place);
                let u = [2, 3].map(|k| (shift[k] + (ray as f64 + 1.0) * R4[k]).fract() as f32);
                Self {
                    point: SurfacePoint { cell: [texel % width, texel / width], st },
                    texel,
                    area: scene.areas[patch].mean() as f32,
                    normal: Vec3::new(-sx, -sy, 1.0).normalize(),
                    mask,
                    u: u.map(|u| u.min(1.0 - f32::EPSILON / 2.0)),
                    stream: stream.at((ray as u64 + 1) << 20),
                }
            })
            .collect()
    }

    /// The number that decides whether the path's product is worth its cost.
    pub(super) fn roulette(&self) -> f32 {
        self.stream.uniform(ROULETTE)
    }

    /// A first direction, by the cosine or by the lobes that a random viewer sees.
    fn direction(&self, scene: &Scene<'_>, brdf: &Brdf) -> Option<Vec3> {
        if brdf.specular.is_none() || self.stream.uniform(0) < COSINE_SHARE {
            return Some(Frame::around(self.normal).to_outer(warp::cosine_hemisphere(self.u)));
        }
        let seen: Vec<usize> = seen_directions(&self.mask, self.normal, scene).collect();
        let viewer = *seen.get((self.stream.uniform(1) * seen.len() as f32) as usize)?;
        let lobe = Brdf { diffuse: [0.0; 3], ..*brdf };
        let wo = Vec3::from(scene.directions.vectors[viewer]);
        lobe.sample(self.normal, wo, [self.u[0], self.u[1], 0.0]).map(|sample| sample.wi)
    }
}

/// Directions of a mask that lie in front of a tangent plane.
fn seen_directions<'a>(mask: &'a [u64], normal: Vec3, scene: &'a Scene<'_>) -> impl Iterator<Item = usize> + 'a {
    (0..scene.directions.len()).filter(move |&k| {
        mask[k / 64] >> (k % 64) & 1 == 1 && normal.dot(Vec3::from(scene.directions.vectors[k])) > 0.0
    })
}

/// What the places see, direction by direction: the bits of one direction fit a cache, those of a place are scattered.
pub(super) fn masks(scene: &Scene<'_>, places: &[usize]) -> Vec<Mask> {
    let words = scene.directions.len().div_ceil(64);
    let mut masks = vec![vec![0; words]; places.len()];
    let slots: Vec<usize> = places.iter().map(|&place| scene.slot_of[place] as usize).collect();
    for direction in 0..scene.directions.len() {
        let bits = scene.bits.direction(direction);
        for (mask, &slot) in masks.iter_mut().zip(&slots) {
            mask[direction / 64] |= (bits[slot / 64] >> (slot % 64) & 1) << (direction % 64);
        }
    }
    masks
}

/// Follows the paths from their starts; those that leave the surface at once are dropped.
pub(super) fn trace<'a>(scene: &Scene<'_>, starts: &'a [Start]) -> Vec<Path<'a>> {
    starts.iter().filter_map(|start| follow(scene, start)).collect()
}

/// The base BRDF of a texel.
pub(super) fn brdf_of(scene: &Scene<'_>, texel: usize) -> Brdf {
    scene.fine.color.as_ref().map_or(scene.fine.brdf, |color| scene.fine.brdf.tinted(color[texel]))
}

fn follow<'a>(scene: &Scene<'_>, start: &'a Start) -> Option<Path<'a>> {
    let width = scene.fine.heights.size()[0];
    let direction = start.direction(scene, &brdf_of(scene, start.texel))?;
    let mut point = start.point;
    let (mut towards, mut weight) = (direction, [1.0_f32; 3]);
    let mut vertices = Vec::new();
    let mut dimension = 2;
    while let Some(hit) = scene.tracer.intersect_from(point, towards) {
        // the underside of a surface without thickness is met by rays that graze an edge: nothing is there
        if hit.normal.dot(towards) >= 0.0 {
            break;
        }
        let texel = hit.point.cell[1] * width + hit.point.cell[0];
        let place = scene.splits.place_at(texel, hit.point.st);
        vertices.push(Vertex { place, texel, normal: hit.normal, back: -towards, weight });
        let random = |k: u64| start.stream.uniform(dimension + k);
        let Some(next) = brdf_of(scene, texel).sample(hit.normal, -towards, [random(0), random(1), random(2)]) else {
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
    (!vertices.is_empty()).then_some(Path { start, direction, vertices })
}
