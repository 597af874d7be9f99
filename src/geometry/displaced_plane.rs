//! A plane displaced by a tiled height field, alone or on a large shape: what a scene's rays meet.
//!
//! Base frame: x = +u, y = −v, z out, metres; the first tile's corner is the origin, so the plane covers
//! 0 <= x <= width, −height <= y <= 0. The tiles are instances of one: rays are followed in the cells of that tile, so
//! that neither memory nor precision depends on their number. The plane is a solid: whatever gets below the surface, or
//! comes in through a rim or from underneath, meets it there.

use glam::{DVec3, Vec3};

use super::large_shape::{Facet, LargeShape, Stretch};
use super::{Boundary, HeightTracer, Hit, Ray, SurfacePoint};

/// A displaced plane.
#[derive(Clone, Debug)]
pub struct DisplacedPlane<'a> {
    tile: HeightTracer<'a>,
    large: Option<&'a LargeShape>,
    /// Metres along x and −y.
    extent: [f64; 2],
    /// Lowest and highest vertex of the tile.
    range: [f64; 2],
}

/// Where a ray meets a [`DisplacedPlane`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneHit {
    /// Distance in units of the ray's direction.
    pub t: f64,
    /// Cell of the tile and the fraction of it.
    pub point: SurfacePoint,
    /// Position in the base frame.
    pub position: DVec3,
    /// Unit normal of the surface, z > 0.
    pub normal: Vec3,
    /// The part of the large shape underneath; flat where there is none.
    pub facet: Facet,
}

impl<'a> DisplacedPlane<'a> {
    /// `tiles[0] × tiles[1]` tiles side by side, on `large` if there is one.
    ///
    /// # Panics
    /// If a map that does not repeat is to be tiled, or the large shape does not cover the plane (to 1e-5).
    pub fn new(tile: HeightTracer<'a>, tiles: [u32; 2], large: Option<&'a LargeShape>) -> Self {
        let heights = tile.heights();
        assert!(heights.boundary() == Boundary::Repeat || tiles == [1, 1], "only maps that repeat are tiled");
        let size = heights.extent().map(f64::from);
        let extent = [0, 1].map(|k| size[k] * f64::from(tiles[k]));
        if let Some(large) = large {
            let fits = |k: usize| (large.extent()[k] / extent[k] - 1.0).abs() < 1e-5;
            assert!(fits(0) && fits(1), "the large shape covers the plane");
        }
        let range = heights.range().map(f64::from);
        Self { tile, large, extent, range }
    }

    /// Tracer of the tile.
    pub fn tile(&self) -> &HeightTracer<'a> {
        &self.tile
    }

    /// The large shape, if there is one.
    pub fn large(&self) -> Option<&'a LargeShape> {
        self.large
    }

    /// Metres covered along x and −y.
    pub fn extent(&self) -> [f64; 2] {
        self.extent
    }

    /// Lowest and highest point that the surface can have.
    pub fn range(&self) -> [f64; 2] {
        let [low, high] = self.large.map_or([0.0; 2], LargeShape::range);
        [self.range[0] + low, self.range[1] + high]
    }

    /// Whether `point` is above the surface, or beside the plane.
    pub fn is_outside(&self, point: DVec3) -> bool {
        let place = [point.x / self.extent[0], -point.y / self.extent[1]];
        if place.iter().any(|x| !(0.0..=1.0).contains(x)) {
            return true;
        }
        let facet = self.large.map_or(Facet::FLAT, |large| large.facet_at(point.x, point.y));
        let local = DVec3::new(point.x, point.y, facet.gap(point));
        let up = Ray { origin: local, direction: Vec3::Z };
        local.z > self.range[1] || (local.z >= self.range[0] && self.tile.intersect(&up).is_none())
    }

    /// Where `ray` meets the surface first.
    pub fn intersect(&self, ray: &Ray) -> Option<PlaneHit> {
        let [t_in, t_out] = self.span_over(ray.origin, ray.direction)?;
        if self.large.is_some() {
            return self.meet_stretches(ray.origin, ray.direction.as_dvec3(), [t_in, t_out]);
        }
        let start = ray.origin + t_in * ray.direction.as_dvec3();
        let hit = self.tile.descend_within(&Ray { origin: start, direction: ray.direction }, t_out - t_in)?;
        Some(PlaneHit::new(Hit { t: t_in + hit.t, ..hit }, Facet::FLAT, hit.position))
    }

    /// Where the half-line that starts on the surface at `from` meets it again.
    pub fn intersect_from(&self, from: &PlaneHit, direction: Vec3) -> Option<PlaneHit> {
        let [_, t_out] = self.span_over(from.position, direction)?;
        let exact = direction.as_dvec3();
        let Some(large) = self.large else {
            let hit = self.tile.intersect_from_within(from.point, direction, t_out)?;
            let position = from.position + (hit.position - self.tile.position(from.point));
            return Some(PlaneHit::new(hit, Facet::FLAT, position));
        };
        let mut first = true;
        large.first(from.position, exact, [0.0, t_out], self.range[1], |stretch| {
            if std::mem::take(&mut first) && stretch.facet == from.facet {
                let local = from.facet.sheared_back(exact).as_vec3();
                let hit = self.tile.intersect_from_within(from.point, local, stretch.span[1])?;
                return Some(PlaneHit::new(hit, stretch.facet, from.position + hit.t * exact));
            }
            self.meet(from.position, exact, stretch)
        })
    }

    /// Whether the surface stands within the first `t_max` of the half-line that starts on it at `from`.
    pub fn occluded(&self, from: &PlaneHit, direction: Vec3, t_max: f64) -> bool {
        let Some([_, t_out]) = self.span_over(from.position, direction) else { return false };
        if self.large.is_none() {
            return self.tile.occluded_within(from.point, direction, t_out.min(t_max));
        }
        self.intersect_from(from, direction).is_some_and(|hit| hit.t < t_max)
    }

    /// Whether what stands around the tile's relief at `from` hides the first `t_max` of `direction` from the top of it.
    ///
    /// The relief itself does not count: the half-line starts above it. Without a large shape nothing else is there.
    pub fn occluded_above_relief(&self, from: &PlaneHit, direction: Vec3, t_max: f64) -> bool {
        self.intersect_above_relief(from, direction).is_some_and(|hit| hit.t < t_max)
    }

    /// Where the half-line that starts above the tile's relief at `from` meets what stands around it.
    pub fn intersect_above_relief(&self, from: &PlaneHit, direction: Vec3) -> Option<PlaneHit> {
        self.large?;
        let lift = self.range[1] - from.facet.gap(from.position);
        let margin = SLAB_MARGIN * (self.range[1] - self.range[0] + from.position.z.abs());
        let origin = from.position + DVec3::Z * (lift.max(0.0) + margin);
        self.intersect(&Ray { origin, direction })
    }

    /// Where a ray meets what is displaced: the large shape, or a plane halfway up the tile. The facet and the distance.
    pub fn base_under(&self, origin: DVec3, direction: DVec3) -> Option<(Facet, f64)> {
        if let Some(large) = self.large {
            return large.meets(origin, direction, self.span_over(origin, direction.as_vec3())?);
        }
        let height = 0.5 * (self.range[0] + self.range[1]);
        let t = (height - origin.z) / direction.z;
        (t > 0.0 && t.is_finite()).then_some((Facet { height, ..Facet::FLAT }, t))
    }

    fn meet_stretches(&self, origin: DVec3, direction: DVec3, span: [f64; 2]) -> Option<PlaneHit> {
        self.large?.first(origin, direction, span, self.range[1], |stretch| self.meet(origin, direction, stretch))
    }

    /// Where a ray that comes from above goes below the surface over one facet.
    fn meet(&self, origin: DVec3, direction: DVec3, stretch: Stretch) -> Option<PlaneHit> {
        let Stretch { facet, span: [t_in, t_out] } = stretch;
        let [start, end] = [t_in, t_out].map(|t| origin + t * direction);
        let gap = facet.gap(start);
        if gap.min(facet.gap(end)) > self.range[1] {
            return None;
        }
        // deep inside of the solid, where a ray comes in through a rim, it meets the surface at once
        let local = DVec3::new(start.x, start.y, gap.max(self.range[0]));
        let ray = Ray { origin: local, direction: facet.sheared_back(direction).as_vec3() };
        let hit = self.tile.descend_within(&ray, t_out - t_in)?;
        let t = t_in + hit.t;
        Some(PlaneHit::new(Hit { t, ..hit }, facet, origin + t * direction))
    }

    /// The part of a ray that lies over the plane and within its range of heights, if any.
    ///
    /// A ray from underneath is followed from where it comes into that range.
    fn span_over(&self, origin: DVec3, direction: Vec3) -> Option<[f64; 2]> {
        let [low, high] = self.range();
        let cell = f64::from(self.tile.heights().spacing()[0]);
        let margin = SLAB_MARGIN * (cell + high - low + low.abs().max(high.abs()));
        let slabs = [
            (origin.x, direction.x, [0.0, self.extent[0]]),
            (-origin.y, -direction.y, [0.0, self.extent[1]]),
            (origin.z, direction.z, [low - margin, high + margin]),
        ];
        let mut span: [f64; 2] = [0.0, f64::INFINITY];
        for (start, dir, [from, to]) in slabs {
            let dir = f64::from(dir);
            if dir == 0.0 {
                if !(from..=to).contains(&start) {
                    return None;
                }
                continue;
            }
            let ends = [(from - start) / dir, (to - start) / dir];
            span = [span[0].max(ends[0].min(ends[1])), span[1].min(ends[0].max(ends[1]))];
        }
        (span[0] <= span[1]).then_some(span)
    }
}

/// Widens the range of heights that rays are followed in, relative to a cell, the range and the heights: above rounding in
/// `f64` and not 0 for a flat map, below anything that costs time.
const SLAB_MARGIN: f64 = 1e-9;

impl PlaneHit {
    /// `hit` of the tile on `facet`: slopes add.
    fn new(hit: Hit, facet: Facet, position: DVec3) -> Self {
        let n = hit.normal;
        let tilt = facet.tilt.as_vec2();
        let normal = if facet.tilt == glam::DVec2::ZERO {
            n
        } else {
            Vec3::new(n.x - tilt.x * n.z, n.y - tilt.y * n.z, n.z).normalize()
        };
        Self { t: hit.t, point: hit.point, position, normal, facet }
    }
}
