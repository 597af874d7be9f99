//! A rectangle that shines to one side, sampled by the solid angle it takes.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

use super::{LightSample, luminance};

/// Solid angle in steradians under which the rectangle is sampled by area instead.
///
/// The angles of a rectangle cancel to a rounding error of about 1e-15, and dividing it by their sines edge-on makes it
/// larger. Over 280 000 views at every slant that share of the solid angle by which a point is misplaced was at most
/// 3e-7 here, a few steps of `u`; it was 2e-6 at 1e-5 sr and 8e-5 at 1e-7 sr. So small a rectangle is either far, and
/// then both densities are nearly the same, or seen edge-on, where it gives little light.
const MIN_SOLID_ANGLE: f64 = 1e-4;

/// Cosine of the angle from y, 2.6°, within which a rectangle is not oriented by y.
const MAX_UPRIGHT_COSINE: f64 = 0.999;

/// A rectangle with the same radiance from every point of its front to every direction.
///
/// From behind it is not there: neither seen nor in the way.
#[derive(Clone, Debug, PartialEq)]
pub struct AreaLight {
    /// The corner from which both edges start, metres.
    corner: DVec3,
    /// Unit vectors along the edges, and the front's normal `x × y`.
    x: DVec3,
    y: DVec3,
    normal: DVec3,
    /// Lengths of the edges, metres.
    lengths: [f64; 2],
    radiance: [f32; 3],
}

impl AreaLight {
    /// The rectangle with the corners `centre ± half_edges[0] ± half_edges[1]`, metres, world frame.
    ///
    /// The front's normal is the direction of `half_edges[0] × half_edges[1]`. `radiance`: RGB, W/(m² sr).
    ///
    /// # Panics
    /// If an edge has no length or the edges are not perpendicular within 1e-6 (sine of the angle that is missing).
    pub fn new(centre: DVec3, half_edges: [DVec3; 2], radiance: [f32; 3]) -> Self {
        let [a, b] = half_edges;
        let lengths = [2.0 * a.length(), 2.0 * b.length()];
        assert!(lengths[0] > 0.0 && lengths[1] > 0.0, "edges with a length");
        let x = a.normalize();
        let along = b.normalize();
        assert!(x.dot(along).abs() < 1e-6, "perpendicular edges");
        let normal = x.cross(along).normalize();
        Self { corner: centre - a - b, x, y: normal.cross(x), normal, lengths, radiance }
    }

    /// The rectangle of `size` metres about `centre` whose front faces `target`.
    ///
    /// `size[1]` runs along `up` made perpendicular, `size[0]` across. Without `up` that is the world's y or, for a
    /// light that looks down or up, −z.
    ///
    /// # Panics
    /// If `centre` is `target`, or `up` is parallel to the way between them, or a size is not positive.
    pub fn facing(centre: DVec3, target: DVec3, up: Option<DVec3>, size: [f64; 2], radiance: [f32; 3]) -> Self {
        assert!(centre != target, "a light that faces somewhere");
        assert!(size[0] > 0.0 && size[1] > 0.0, "sizes in metres, greater than 0");
        let normal = (target - centre).normalize();
        let up = up.unwrap_or(if normal.y.abs() > MAX_UPRIGHT_COSINE { DVec3::NEG_Z } else { DVec3::Y });
        let across = up.cross(normal);
        assert!(across.length() > 1e-9 * up.length(), "an up that is not along the view");
        let across = across.normalize();
        let half_edges = [across * (0.5 * size[0]), normal.cross(across) * (0.5 * size[1])];
        Self::new(centre, half_edges, radiance)
    }

    /// Area in square metres.
    pub fn area(&self) -> f64 {
        self.lengths[0] * self.lengths[1]
    }

    /// Solid angle of the rectangle seen from `from`, steradians; 0 from behind or within its plane.
    pub fn solid_angle(&self, from: DVec3) -> f64 {
        View::new(self, from).map_or(0.0, |view| view.solid_angle)
    }

    /// A direction to the rectangle, uniform over its solid angle or, if that is tiny, over its area.
    pub(super) fn sample(&self, from: DVec3, u: [f32; 2]) -> Option<LightSample> {
        let view = View::new(self, from)?;
        let u = u.map(f64::from);
        let by_angle = view.solid_angle >= MIN_SOLID_ANGLE;
        let local = if by_angle { view.point(u) } else { view.point_by_area(u) };
        let distance = local.length();
        let pdf = if by_angle { 1.0 / view.solid_angle } else { self.pdf_by_area(distance, -view.z0 / distance) };
        let wi = (self.x * local.x + self.y * local.y + self.normal * local.z) / distance;
        Some(LightSample { wi: wi.as_vec3(), distance, radiance: self.radiance, pdf: pdf as f32, is_delta: false })
    }

    /// Distance and radiance where a ray meets the front.
    pub(super) fn emitted(&self, origin: DVec3, direction: Vec3) -> Option<(f64, [f32; 3])> {
        self.hit(origin, direction.as_dvec3()).map(|(distance, _)| (distance, self.radiance))
    }

    /// Density of [`AreaLight::sample`] from `origin`, 1/sr.
    pub(super) fn pdf(&self, origin: DVec3, direction: Vec3) -> f32 {
        let Some((distance, cos_light)) = self.hit(origin, direction.as_dvec3()) else { return 0.0 };
        let solid_angle = self.solid_angle(origin);
        let by_angle = solid_angle >= MIN_SOLID_ANGLE;
        (if by_angle { 1.0 / solid_angle } else { self.pdf_by_area(distance, cos_light) }) as f32
    }

    /// Luminance of about the irradiance on a plane that faces the light: radiance times the solid angle of a disk of
    /// the same area and slant, which stays below 2π up close.
    pub(super) fn strength(&self, from: DVec3) -> f64 {
        let centre = self.corner + 0.5 * (self.lengths[0] * self.x + self.lengths[1] * self.y);
        let away = from - centre;
        let squared = away.length_squared();
        let height = away.dot(self.normal);
        if height <= 0.0 {
            return 0.0;
        }
        luminance(self.radiance) * self.area() * (height / squared.sqrt()) / (squared + self.area() / (2.0 * PI))
    }

    /// Distance to the front along a unit vector, and the cosine there; `None` for a miss.
    fn hit(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64)> {
        let cos_light = -direction.dot(self.normal);
        let height = (origin - self.corner).dot(self.normal);
        if cos_light <= 0.0 || height <= 0.0 {
            return None;
        }
        let distance = height / cos_light;
        let place = origin + direction * distance - self.corner;
        let inside = |along: DVec3, length: f64| (0.0..=length).contains(&place.dot(along));
        (inside(self.x, self.lengths[0]) && inside(self.y, self.lengths[1])).then_some((distance, cos_light))
    }

    /// 1/area turned to 1/sr: distance²/(area·cosθ).
    fn pdf_by_area(&self, distance: f64, cos_light: f64) -> f64 {
        distance * distance / (self.area() * cos_light)
    }
}

/// The rectangle as a point in front of it sees it.
///
/// Local frame: the point is the origin, x and y run along the edges, the rectangle is [x0, x1] × [y0, y1] at z0 < 0.
struct View {
    x: [f64; 2],
    y: [f64; 2],
    z0: f64,
    /// Corner angles on the edge x = x0, at y0 and y1.
    left: [f64; 2],
    solid_angle: f64,
}

impl View {
    /// `None` from behind and within the plane.
    fn new(light: &AreaLight, from: DVec3) -> Option<Self> {
        let to_corner = light.corner - from;
        let z0 = to_corner.dot(light.normal);
        if z0 >= 0.0 {
            return None;
        }
        let [x0, y0] = [to_corner.dot(light.x), to_corner.dot(light.y)];
        Some(Self::of([x0, x0 + light.lengths[0]], [y0, y0 + light.lengths[1]], z0))
    }

    /// The rectangle [x[0], x[1]] × [y[0], y[1]] at `z0` < 0.
    fn of(x: [f64; 2], y: [f64; 2], z0: f64) -> Self {
        let [left, right] = x.map(|x| y.map(|y| corner_angle(x, y, z0)));
        let solid_angle = right[1] - right[0] - (left[1] - left[0]);
        Self { x, y, z0, left, solid_angle }
    }

    /// A point of the rectangle, uniform in solid angle.
    ///
    /// [Ureña et al. 2013] sections 4 and 5: x from the share u[0] of the solid angle on its left, then y from the
    /// share u[1] of the sines of elevation along that line. The angles γ between the planes of the edges are π/2 ∓ the
    /// corner angles.
    fn point(&self, u: [f64; 2]) -> DVec3 {
        let Self { x: [x0, x1], y: [y0, y1], z0, left, solid_angle } = *self;
        let b = [y0, -y1].map(|y| -y / (y * y + z0 * z0).sqrt());
        let (sin, cos) = (u[0] * solid_angle + PI + left[1] - left[0]).sin_cos();
        let f = (cos * b[0] - b[1]) / sin;
        // The clamps absorb rounding at the edges.
        let cos = (1.0f64.copysign(f) / (f * f + b[0] * b[0]).sqrt()).clamp(-1.0, 1.0);
        let x = (-(cos * z0) / (1.0 - cos * cos).sqrt()).clamp(x0, x1);
        let squared = x * x + z0 * z0;
        let [h0, h1] = [y0, y1].map(|y| y / (squared + y * y).sqrt());
        let h = h0 + u[1] * (h1 - h0);
        let y = (h * (squared / (1.0 - h * h)).sqrt()).clamp(y0, y1);
        DVec3::new(x, y, z0)
    }

    /// A point of the rectangle, uniform in area.
    fn point_by_area(&self, u: [f64; 2]) -> DVec3 {
        let at = |[from, to]: [f64; 2], share: f64| from + share * (to - from);
        DVec3::new(at(self.x, u[0]), at(self.y, u[1]), self.z0)
    }
}

/// Solid angle between the foot of the perpendicular and the corner (x, y) of a rectangle at `z0` < 0, signed as x·y.
///
/// atan(x·y / (|z0|·√(x² + y² + z0²))), which has none of the cancellation of the arc cosine of the angle between the
/// planes of two edges that it stands for.
fn corner_angle(x: f64, y: f64, z0: f64) -> f64 {
    let slant = (x * x + y * y + z0 * z0).sqrt();
    (x * y).atan2(-z0 * slant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    /// Rectangles of one metre seen from 0.001 to 1000 metres away, at every slant, edge-on included.
    fn views() -> impl Iterator<Item = (AreaLight, DVec3)> {
        let stream = Stream::new(3, 0);
        (0..20_000).map(move |i| {
            let [a, b] = stream.uniform_pair(2 * i).map(f64::from);
            let [c, d] = stream.uniform_pair(2 * i + 1).map(f64::from);
            let light = AreaLight::new(DVec3::ZERO, [DVec3::Z * 0.5, DVec3::X * 0.5], [1.0; 3]);
            let distance = 10f64.powf(6.0 * a - 3.0);
            let height = distance * 10f64.powf(-5.0 * b * b);
            let across = (distance * distance - height * height).sqrt() * (TAU * c).sin();
            (light, DVec3::new(across + d - 0.5, height, (distance - height) * (TAU * c).cos()))
        })
    }

    const TAU: f64 = 2.0 * PI;

    #[test]
    fn points_divide_the_solid_angle_as_the_random_numbers_do() {
        let mut checked = 0;
        for (k, (light, from)) in views().enumerate() {
            let view = View::new(&light, from).unwrap();
            if view.solid_angle < MIN_SOLID_ANGLE {
                continue;
            }
            checked += 1;
            let u = Stream::new(4, 0).uniform_pair(k as u64).map(f64::from);
            let point = view.point(u);
            // Eight steps of `u`.
            let left = View::of([view.x[0], point.x], view.y, view.z0).solid_angle / view.solid_angle;
            assert!((left - u[0]).abs() < 5e-7, "{from}: {left}, wanted {}", u[0]);
            // Along the line at x solid angle goes by the sine of elevation.
            let sine = |y: f64| y / point.x.hypot(view.z0).hypot(y);
            let below = (sine(point.y) - sine(view.y[0])) / (sine(view.y[1]) - sine(view.y[0]));
            assert!((below - u[1]).abs() < 5e-7, "{from}: {below}, wanted {}", u[1]);
        }
        assert!(checked > 10_000, "{checked}");
    }

    #[test]
    fn a_sample_has_the_density_and_the_distance_of_a_look_along_it() {
        let mut beside = 0;
        for (k, (light, from)) in views().enumerate() {
            let Some(sample) = light.sample(from, Stream::new(5, 0).uniform_pair(k as u64)) else { continue };
            // A direction of f32 misses a rim within its rounding; edge-on, all of the rectangle may be as thin.
            let Some((distance, radiance)) = light.emitted(from, sample.wi) else {
                beside += 1;
                continue;
            };
            let slant = from.y / sample.distance;
            assert!((distance / sample.distance - 1.0).abs() < 2e-7 / slant, "{from}: {sample:?}, {distance}");
            assert_eq!(radiance, sample.radiance);
            let pdf = light.pdf(from, sample.wi);
            assert!(f64::from(pdf / sample.pdf - 1.0).abs() < 6e-7 / slant + 2e-7, "{from}: {sample:?}, {pdf}");
        }
        assert!(beside < 60, "{beside} of 20000");
    }

    #[test]
    fn solid_angles_are_the_closed_ones() {
        let square = AreaLight::facing(DVec3::Y, DVec3::ZERO, None, [2.0, 2.0], [1.0; 3]);
        // One face of the cube about the point is a sixth of the sphere.
        assert!((square.solid_angle(DVec3::ZERO) - 4.0 * PI / 6.0).abs() < 1e-14);
        // Three faces of a cube of twice the edge meet at its corner and share an eighth: a twenty-fourth each.
        assert!((square.solid_angle(DVec3::new(1.0, -1.0, 1.0)) - 4.0 * PI / 24.0).abs() < 1e-14);
        assert_eq!(square.solid_angle(DVec3::new(0.0, 1.0, 0.0)), 0.0);
        assert_eq!(square.solid_angle(DVec3::new(0.3, 1.5, 0.0)), 0.0);
        // From close by, the rectangle is half of what there is to see.
        assert!((square.solid_angle(DVec3::new(0.0, 1.0 - 1e-9, 0.0)) - TAU).abs() < 1e-8);
    }

    #[test]
    fn a_facing_rectangle_shines_on_its_target() {
        let slanted = DVec3::new(0.3, 1.0, -2.0);
        for (centre, up) in [
            (slanted, None),
            (slanted, Some(DVec3::Z)),
            (DVec3::Y, None),
            (-DVec3::Y, None),
            (DVec3::Y, Some(DVec3::X)),
        ] {
            let light = AreaLight::facing(centre, DVec3::ZERO, up, [0.4, 0.2], [2.0; 3]);
            assert!((light.area() - 0.08).abs() < 1e-15);
            let (distance, radiance) = light.emitted(DVec3::ZERO, centre.normalize().as_vec3()).unwrap();
            assert!((distance - centre.length()).abs() < 1e-6);
            assert_eq!(radiance, [2.0; 3]);
            assert!(light.emitted(2.0 * centre, -centre.normalize().as_vec3()).is_none());
        }
    }
}
