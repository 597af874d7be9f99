//! One ray against one bilinear cell, in `f64`: the last step of every trace.
//!
//! The surface is a function of (x, y), so a ray is above it or below it and nothing else. With the gap
//! g(t) = z(t) − h(x(t), y(t)), a quadratic in t over one cell, a ray that starts above is stopped where g first falls
//! below 0. Cells share the very expression for the t of their common border, so no ray slips between two of them:
//! a sign change lost to rounding in one cell is found at the entry of the next.

/// A ray over the plane of cells, in cell units from the corner of the cell that it starts in.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellRay {
    /// Where it starts, as a fraction of its first cell along u and v; representable in `f32`.
    pub(super) start: [f64; 2],
    /// Cells along u and v per metre of t.
    pub(super) dir: [f64; 2],
    /// 1 / `dir`, finite: a ray parallel to an axis leans infinitesimally into its own cell.
    pub(super) inv: [f64; 2],
    /// Height of the start and climb per metre of t.
    pub(super) z: f64,
    pub(super) dz: f64,
    /// The ray ends here, metres.
    pub(super) t_end: f64,
}

/// Largest |1 / `dir`|: with this, t stays finite in `f32` for 1e8 cells.
const PARALLEL: f64 = 1e30;

impl CellRay {
    /// A ray from the fraction `start` of a cell; `dir` in cells per metre.
    pub(super) fn new(start: [f32; 2], dir: [f64; 2], z: f64, dz: f64) -> Self {
        let start = start.map(f64::from);
        let inv = [0, 1].map(|axis| {
            if dir[axis].abs() * PARALLEL > 1.0 {
                1.0 / dir[axis]
            } else if start[axis] >= 0.5 {
                -PARALLEL
            } else {
                PARALLEL
            }
        });
        Self { start, dir, inv, z, dz, t_end: f64::INFINITY }
    }

    /// t at which the ray meets the plane at `x` cells along `axis`.
    #[inline]
    pub(super) fn t_at(&self, axis: usize, x: f64) -> f64 {
        (x - self.start[axis]) * self.inv[axis]
    }

    /// The part of the ray over the cell whose corner is at `cell`; empty if the first exceeds the second.
    #[inline]
    fn span(&self, cell: [f64; 2]) -> [f64; 2] {
        let side = |axis: usize| {
            let [a, b] = [self.t_at(axis, cell[axis]), self.t_at(axis, cell[axis] + 1.0)];
            if self.inv[axis] > 0.0 { [a, b] } else { [b, a] }
        };
        let ([u_in, u_out], [v_in, v_out]) = (side(0), side(1));
        [u_in.max(v_in).max(0.0), u_out.min(v_out).min(self.t_end)]
    }
}

/// The side of the surface that a ray starts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Above,
    Below,
}

impl Side {
    /// 0 above and 1 below.
    #[inline(always)]
    pub(super) fn index(self) -> usize {
        usize::from(self == Side::Below)
    }
}

/// One bilinear cell: corner heights `[h00, h10, h01, h11]` and where it lies from the ray's first cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    pub(super) corners: [f64; 4],
    pub(super) cell: [f64; 2],
}

/// The gap over one cell as a Bernstein quadratic: `g0 (1 − x)² + 2 g1 x (1 − x) + g2 x²`, x from 0 to 1 over `span`.
struct Gap {
    span: [f64; 2],
    g: [f64; 3],
}

impl Patch {
    /// Height at the fraction (s, t) of the cell.
    #[inline]
    pub(super) fn height(&self, [s, t]: [f64; 2]) -> f64 {
        let [h00, h10, h01, h11] = self.corners;
        ((1.0 - s) * h00 + s * h10) * (1.0 - t) + ((1.0 - s) * h01 + s * h11) * t
    }

    /// ∂²h/∂s∂t, the one second derivative that a bilinear cell has.
    #[inline]
    fn twist(&self) -> f64 {
        let [h00, h10, h01, h11] = self.corners;
        (h00 - h10) + (h11 - h01)
    }

    #[inline]
    fn gap(&self, ray: &CellRay) -> Option<Gap> {
        let span = ray.span(self.cell);
        let length = span[1] - span[0];
        // `!(>= 0)` would also catch a NaN; spans are finite by construction of `inv` and `t_end`.
        if length < 0.0 {
            return None;
        }
        let at = |t: f64| {
            let place = [0, 1].map(|axis| ray.start[axis] - self.cell[axis] + ray.dir[axis] * t);
            ray.z + ray.dz * t - self.height(place)
        };
        let [g0, g2] = span.map(at);
        let curvature = -self.twist() * (ray.dir[0] * length) * (ray.dir[1] * length);
        Some(Gap { span, g: [g0, 0.5 * (g0 + g2 - curvature), g2] })
    }

    /// Whether a ray that comes from above dips below this cell by more than `tolerance` metres.
    #[inline]
    pub(super) fn stops(&self, ray: &CellRay, tolerance: f64) -> bool {
        let Some(Gap { g: [g0, g1, g2], .. }) = self.gap(ray) else { return false };
        g0.min(g2) < -tolerance || (g1 < -tolerance && g1 * g1 > g0.max(0.0) * g2.max(0.0))
    }

    /// First t at which the ray leaves its `side` of the surface over this cell.
    #[inline]
    pub(super) fn crossing(&self, ray: &CellRay, side: Side, tolerance: f64) -> Option<f64> {
        let Gap { span, g } = self.gap(ray)?;
        let [g0, g1, g2] = if side == Side::Above { g } else { g.map(|g| -g) };
        let root = (g1 * g1 - g0 * g2).max(0.0).sqrt();
        let x = if g0 < -tolerance {
            0.0 // crossed within rounding of the border before
        } else if g2 < -tolerance && g0 <= tolerance && g1 > g0 {
            // Starts on the border's surface and rises: x = 0 is the start itself, the other root is the hit.
            (g1 - g0 + root) / (2.0 * g1 - g0 - g2)
        } else if g2 < -tolerance || (g1 < -tolerance && g1 * g1 > g0.max(0.0) * g2.max(0.0)) {
            // The smaller root with no cancellation: both terms of the denominator are positive when g1 < g0.
            g0.max(0.0) / (g0 - g1 + root)
        } else {
            return None;
        };
        Some(span[0] + (span[1] - span[0]) * x.clamp(0.0, 1.0))
    }

    /// The cell that the ray starts on, at its own fraction of it: the root t = 0 divided out of the gap.
    ///
    /// g(t)/t = a t + b with a = −twist·du·dv, b = dz − ∂h/∂s du − ∂h/∂t dv: what is left is linear and exact at the
    /// start, so no offset along the normal is needed. Returns the side that the ray leaves to and its next crossing
    /// within this cell.
    #[inline]
    pub(super) fn departure(&self, ray: &CellRay) -> (Side, Option<f64>) {
        let [h00, h10, h01, h11] = self.corners;
        let [s, t] = ray.start;
        let climb = [
            (h10 - h00) * (1.0 - t) + (h11 - h01) * t, // ∂h/∂s
            (h01 - h00) * (1.0 - s) + (h11 - h10) * s, // ∂h/∂t
        ];
        let [along_u, along_v] = [climb[0] * ray.dir[0], climb[1] * ray.dir[1]];
        let b = ray.dz - along_u - along_v;
        let a = -self.twist() * ray.dir[0] * ray.dir[1];
        // Rounding of b where the ray runs within the tangent plane.
        let rounding = 8.0 * f64::EPSILON * (ray.dz.abs() + along_u.abs() + along_v.abs());
        let t_out = ray.span([0.0; 2])[1];
        let end = a * t_out + b;
        match (b, end) {
            _ if b < -rounding => (Side::Below, (end > rounding).then(|| -b / a)),
            _ if end < -rounding => (Side::Above, Some((-b / a).max(0.0))),
            _ => (Side::Above, None),
        }
    }
}
