//! The large shape under a tiled surface: a height field of triangles that is never filtered.
//!
//! The surface of a bi-scale object is z = L(x, y) + h(x, y) with the tiled detail h. Each cell of L is two triangles, so
//! that over one of them ([`Facet`]) L is a plane and adding it is a shear, (x, y, z) → (x, y, z + L). A shear keeps lines
//! straight: over a facet a ray meets the sum where the sheared-back ray meets h alone, exactly.

use glam::{DVec2, DVec3};

use super::{Boundary, HeightField};

/// The large shape: triangles over the whole plane, and the highest point under every block of its cells.
#[derive(Clone, Debug)]
pub struct LargeShape {
    heights: HeightField,
    /// Largest height of blocks of 2^l × 2^l cells, level by level from single cells to the one that covers all.
    maxima: Vec<Blocks>,
    /// Smallest and largest height, metres: every ray asks for it.
    range: [f64; 2],
}

/// The highest vertex of each block of one size, `[v][u]`.
#[derive(Clone, Debug)]
struct Blocks {
    width: usize,
    max: Vec<f32>,
}

/// One triangle of the large shape as the plane z = `height` + `tilt`·(x, y).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facet {
    /// Height of the plane over the origin of the base frame, metres.
    pub height: f64,
    /// Slopes (∂L/∂x, ∂L/∂y), y = −v.
    pub tilt: DVec2,
}

/// A part of a ray that lies over one facet.
#[derive(Clone, Copy, Debug)]
pub struct Stretch {
    /// The facet under it.
    pub facet: Facet,
    /// From where to where, in units of the ray's direction.
    pub span: [f64; 2],
}

/// A straight line over the plane, in cells of the large shape, and its height in metres.
#[derive(Clone, Copy, Debug)]
struct PlaneLine {
    start: [f64; 2],
    dir: [f64; 2],
    z: f64,
    dz: f64,
}

impl LargeShape {
    /// The shape with these vertices: cell (i, j) is cut from vertex (i, j) to (i + 1, j + 1).
    ///
    /// # Panics
    /// If the field repeats: a large shape is one piece.
    pub fn new(heights: HeightField) -> Self {
        assert_eq!(heights.boundary(), Boundary::Clamp, "a large shape is one piece");
        let [columns, rows] = heights.size();
        let cell_max = |k: usize| heights.corners(k % columns, k / columns).into_iter().fold(f32::MIN, f32::max);
        let mut maxima = vec![Blocks { width: columns, max: (0..columns * rows).map(cell_max).collect() }];
        let mut height = rows;
        while let Some(finer) = maxima.last().filter(|blocks| blocks.max.len() > 1) {
            let coarser = finer.halved(height);
            height = height.div_ceil(2);
            maxima.push(coarser);
        }
        let range = heights.range().map(f64::from);
        Self { heights, maxima, range }
    }

    /// Metres covered along x and −y.
    pub fn extent(&self) -> [f64; 2] {
        self.heights.extent().map(f64::from)
    }

    /// Smallest and largest height in metres.
    pub fn range(&self) -> [f64; 2] {
        self.range
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let floats: usize = self.maxima.iter().map(|blocks| blocks.max.len()).sum();
        (floats + self.heights.heights().len()) * size_of::<f32>()
    }

    /// The facet under (x, y), which lies within the extent.
    pub fn facet_at(&self, x: f64, y: f64) -> Facet {
        let size = self.heights.size();
        let [dx, dy] = self.spacing();
        let place = [x / dx, -y / dy];
        let cell = [0, 1].map(|k| (place[k].max(0.0) as usize).min(size[k] - 1));
        let [s, t] = [0, 1].map(|k| place[k] - cell[k] as f64);
        self.facet(cell, s >= t)
    }

    /// Where the part `span` of a ray, which lies over the extent, first meets the shape alone: the facet and the distance.
    pub fn meets(&self, origin: DVec3, direction: DVec3, span: [f64; 2]) -> Option<(Facet, f64)> {
        self.first(origin, direction, span, 0.0, |stretch| {
            let [z0, z1] = stretch.span.map(|t| stretch.facet.gap(origin + t * direction));
            (z1 < 0.0).then(|| {
                let part = if z0 > 0.0 { z0 / (z0 - z1) } else { 0.0 };
                (stretch.facet, stretch.span[0] + part * (stretch.span[1] - stretch.span[0]))
            })
        })
    }

    /// The first `Some` that `visit` gives for the stretches of a ray, in order, that come within `above` metres over the
    /// highest point of their cell.
    ///
    /// `span` is the part of the ray to look at, which lies over the extent. Blocks that the ray passes well above are
    /// stepped over as a whole (maximum mipmap: larger blocks after each step, smaller ones where they are met).
    pub fn first<R>(
        &self,
        origin: DVec3,
        direction: DVec3,
        span: [f64; 2],
        above: f64,
        mut visit: impl FnMut(Stretch) -> Option<R>,
    ) -> Option<R> {
        let [dx, dy] = self.spacing();
        let line = PlaneLine {
            start: [origin.x / dx, -origin.y / dy],
            dir: [direction.x / dx, -direction.y / dy],
            z: origin.z,
            dz: direction.z,
        };
        let top = self.maxima.len() - 1;
        let size = self.heights.size();
        let mut t = span[0];
        let mut cell = [0, 1].map(|k| line.cell_at(t, k, size[k]));
        let mut level = 0;
        loop {
            let (t_out, axis) = line.leaves(cell, level, span[1]);
            let low = line.z + line.dz * if line.dz < 0.0 { t_out } else { t };
            if low > f64::from(self.maxima[level].max_over(cell, level)) + above {
                t = t_out;
            } else if level > 0 {
                level -= 1;
                continue;
            } else {
                if let Some(found) = self.visit_cell(&line, cell, [t, t_out], &mut visit) {
                    return Some(found);
                }
                t = t_out;
            }
            if !line.step(&mut cell, axis?, level, t, size) {
                return None;
            }
            level = (level + 1).min(top);
        }
    }

    /// Visits the one or two facets of a cell in the order of the line.
    fn visit_cell<R>(
        &self,
        line: &PlaneLine,
        cell: [usize; 2],
        [t_in, t_out]: [f64; 2],
        visit: &mut impl FnMut(Stretch) -> Option<R>,
    ) -> Option<R> {
        // s − t > 0 on the upper triangle (0,0)-(1,0)-(1,1): linear along the line
        let side = |t: f64| {
            let place = [0, 1].map(|k| line.start[k] + line.dir[k] * t - cell[k] as f64);
            place[0] - place[1]
        };
        let [a, b] = [side(t_in), side(t_out)];
        if a * b >= 0.0 {
            return visit(Stretch { facet: self.facet(cell, a + b >= 0.0), span: [t_in, t_out] });
        }
        let t_mid = (t_in + (t_out - t_in) * (a / (a - b))).clamp(t_in, t_out);
        visit(Stretch { facet: self.facet(cell, a > 0.0), span: [t_in, t_mid] })
            .or_else(|| visit(Stretch { facet: self.facet(cell, b > 0.0), span: [t_mid, t_out] }))
    }

    /// The triangle of a cell on the side where s >= t (`upper`), s along u and t along v.
    fn facet(&self, [i, j]: [usize; 2], upper: bool) -> Facet {
        let [h00, h10, h01, h11] = self.heights.corners(i, j).map(f64::from);
        let [dx, dy] = self.spacing();
        let [along_u, along_v] = if upper { [h10 - h00, h11 - h10] } else { [h11 - h01, h01 - h00] };
        let tilt = DVec2::new(along_u / dx, -along_v / dy);
        let corner = DVec2::new(i as f64 * dx, -(j as f64) * dy);
        Facet { height: h00 - tilt.dot(corner), tilt }
    }

    fn spacing(&self) -> [f64; 2] {
        self.heights.spacing().map(f64::from)
    }
}

impl Facet {
    /// A facet of no shape at all.
    pub const FLAT: Self = Self { height: 0.0, tilt: DVec2::ZERO };

    /// Height of `point` above this plane, metres.
    #[inline]
    pub fn gap(&self, point: DVec3) -> f64 {
        point.z - self.height - self.tilt.dot(point.truncate())
    }

    /// `direction` in the frame in which this plane is z = 0: the inverse shear.
    #[inline]
    pub fn sheared_back(&self, direction: DVec3) -> DVec3 {
        DVec3::new(direction.x, direction.y, direction.z - self.tilt.dot(direction.truncate()))
    }
}

impl Blocks {
    fn halved(&self, height: usize) -> Self {
        let width = self.width.div_ceil(2);
        let max_of = |k: usize| {
            let [x, y] = [2 * (k % width), 2 * (k / width)];
            let inside =
                |dx: usize, dy: usize| (x + dx < self.width && y + dy < height).then(|| (y + dy) * self.width + x + dx);
            let four = [inside(0, 0), inside(1, 0), inside(0, 1), inside(1, 1)];
            four.into_iter().flatten().map(|k| self.max[k]).fold(f32::MIN, f32::max)
        };
        Self { width, max: (0..width * height.div_ceil(2)).map(max_of).collect() }
    }

    /// Largest height of the block of 2^level cells that holds `cell`.
    #[inline]
    fn max_over(&self, cell: [usize; 2], level: usize) -> f32 {
        self.max[(cell[1] >> level) * self.width + (cell[0] >> level)]
    }
}

impl PlaneLine {
    /// The cell along an axis at `t`.
    fn cell_at(&self, t: f64, axis: usize, cells: usize) -> usize {
        ((self.start[axis] + self.dir[axis] * t).max(0.0) as usize).min(cells - 1)
    }

    /// When the line leaves the block of 2^level cells that holds `cell`, and through which axis; `end` and none where
    /// it ends before.
    #[inline]
    fn leaves(&self, cell: [usize; 2], level: usize, end: f64) -> (f64, Option<usize>) {
        let exit = |axis: usize| {
            let block = cell[axis] >> level;
            match self.dir[axis] {
                d if d > 0.0 => (((block + 1) << level) as f64 - self.start[axis]) / d,
                d if d < 0.0 => ((block << level) as f64 - self.start[axis]) / d,
                _ => f64::INFINITY,
            }
        };
        let [u, v] = [exit(0), exit(1)];
        let (t, axis) = if u <= v { (u, 0) } else { (v, 1) };
        if t < end { (t, Some(axis)) } else { (end, None) }
    }

    /// Moves `cell` to the first cell beyond the block, through `axis`; whether there is one.
    ///
    /// Along `axis` the cell is known from the block, whatever rounding makes of the place; along the other the place
    /// tells, kept within the block that is left.
    #[inline]
    fn step(&self, cell: &mut [usize; 2], axis: usize, level: usize, t: f64, size: [usize; 2]) -> bool {
        let other = 1 - axis;
        let block = cell[other] >> level;
        let [first, last] = [block << level, (((block + 1) << level) - 1).min(size[other] - 1)];
        cell[other] = self.cell_at(t, other, size[other]).clamp(first, last);
        let block = cell[axis] >> level;
        if self.dir[axis] > 0.0 {
            cell[axis] = (block + 1) << level;
            cell[axis] < size[axis]
        } else if block == 0 {
            false
        } else {
            cell[axis] = (block << level) - 1;
            true
        }
    }
}
