//! How a table is indexed: the direction map, bilinear taps, the octahedral map.
//!
//! The compiler fills its tables with this code and a reader looks them up with it, so that both mean the same texel.
//! All directions are unit vectors in the base frame: x = +u, y = −v, z out of the surface.

use crate::elementary::atan_in_octants;
use serde::{Deserialize, Serialize};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// What lies beyond the rim of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Boundary {
    /// The map tiles the plane.
    Repeat,
    /// The map is one piece; the nearest value holds beyond the outermost centres.
    Clamp,
}

/// Direction of the point `square` ∈ [0, 1]² of the concentric equal-area map.
///
/// With a = 2·`square[0]` − 1 and b = 2·`square[1]` − 1: [Shirley and Chiu 1997] (r, φ) = (a, π/4·b/a) where |a| > |b|,
/// else (b, π/2 − π/4·a/b); then z = 1 − r² and (x, y) = r√(2 − r²)·(cos φ, sin φ). `square[0]` runs along +x and
/// `square[1]` along +y: (1, ½) is +x, (½, 1) is +y, (½, ½) is z, the rim of the square is the horizon. As
/// dω = dz dφ = 2r dr dφ, equal areas of the square are equal solid angles (2π times the area).
#[inline]
pub fn direction_of(square: [f32; 2]) -> [f32; 3] {
    let [a, b] = square.map(|s| 2.0 * s - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0, 0.0, 1.0];
    }
    let (r, phi) = if a.abs() > b.abs() { (a, FRAC_PI_4 * (b / a)) } else { (b, FRAC_PI_2 - FRAC_PI_4 * (a / b)) };
    let (sin, cos) = phi.sin_cos();
    // A negative r mirrors (cos φ, sin φ), which is φ + π; √(2 − r²) never sees 1 − z², which cancels near the pole.
    let sin_theta = r * (2.0 - r * r).max(0.0).sqrt();
    [sin_theta * cos, sin_theta * sin, 1.0 - r * r]
}

/// Point of the unit square whose [`direction_of`] is `direction`; directions below the horizon go to the rim.
///
/// r = √(1 − z), taken as √((x² + y²)/(1 + z)): no cancellation near the pole.
#[inline]
pub fn square_of(direction: [f32; 3]) -> [f32; 2] {
    let [x, y, z] = direction;
    let horizontal = x * x + y * y;
    if horizontal == 0.0 {
        return [0.5, 0.5];
    }
    // The minimum absorbs rounding at the horizon, and everything below it.
    let r = if z > 0.0 { (horizontal / (1.0 + z)).sqrt().min(1.0) } else { 1.0 };
    // Written as choices between values: which axis is longer is as good as random, a branch would not pay.
    let is_x_longer = x.abs() > y.abs();
    let long = if is_x_longer { x } else { y };
    let short = if is_x_longer { y } else { x };
    let far = r.copysign(long);
    let near = far * atan_in_octants(short / long);
    let a = if is_x_longer { far } else { near };
    let b = if is_x_longer { near } else { far };
    [0.5 + 0.5 * a, 0.5 + 0.5 * b]
}

/// Directions at the centres of `n` × `n` cells of the concentric map, `[row][col]`.
///
/// Index row·n + col lies at the square's point ((col + ½)/n, (row + ½)/n): columns along +x, rows along +y.
pub fn direction_grid(n: usize) -> Vec<[f32; 3]> {
    let centre = |k: usize| (k as f32 + 0.5) / n as f32;
    (0..n * n).map(|index| direction_of([centre(index % n), centre(index / n)])).collect()
}

/// The two texels that a linear lookup at the fraction `coord` of `n` texels reads, and their weights, which sum to 1.
///
/// Texel k has its centre at (k + ½)/n. Beyond the outermost centres [`Boundary::Repeat`] blends the last texel with
/// the first and [`Boundary::Clamp`] holds the outermost. `Repeat` takes any finite `coord`.
#[inline]
pub fn taps(coord: f32, n: usize, boundary: Boundary) -> [(usize, f32); 2] {
    let last = n - 1;
    let (first, second, weight) = match boundary {
        Boundary::Repeat => {
            let place = (coord - coord.floor()) * n as f32 - 0.5;
            let below = place.floor();
            // −1 before the first centre; rounding up to n − ½ keeps `below` at most n − 1.
            let first = if below < 0.0 { last } else { (below as usize).min(last) };
            (first, if first == last { 0 } else { first + 1 }, place - below)
        }
        Boundary::Clamp => {
            let place = (coord * n as f32 - 0.5).max(0.0).min(last as f32);
            let first = place as i32; // quicker than to `usize`: `place` is within [0, last]
            (first as usize, (first as usize + 1).min(last), place - first as f32)
        }
    };
    [(first, 1.0 - weight), (second, weight)]
}

/// The four texels of a bilinear lookup at the fraction `x` of a `size[0]` × `size[1]` table, index v·`size[0]` + u.
#[inline]
pub fn bilinear_taps(x: [f32; 2], size: [usize; 2], boundary: Boundary) -> [(usize, f32); 4] {
    let [(u0, a0), (u1, a1)] = taps(x[0], size[0], boundary);
    let [(v0, b0), (v1, b1)] = taps(x[1], size[1], boundary);
    let [row0, row1] = [v0 * size[0], v1 * size[0]];
    [(row0 + u0, a0 * b0), (row0 + u1, a1 * b0), (row1 + u0, a0 * b1), (row1 + u1, a1 * b1)]
}

/// The four cells of an `n` × `n` direction table around `direction`, and their weights, which sum to 1.
///
/// Bilinear in the concentric square; no wrap: beyond the outermost centres the nearest hold.
#[inline]
pub fn angular_taps(direction: [f32; 3], n: usize) -> [(usize, f32); 4] {
    bilinear_taps(square_of(direction), [n, n], Boundary::Clamp)
}

/// Octahedral coordinates in [−1, 1]² of a unit direction.
///
/// (p, q) = (x, y)/(|x| + |y| + |z|); where z < 0 the corners fold out: (1 − |q|, 1 − |p|) with the signs of (x, y).
#[inline]
pub fn octahedral_encode(direction: [f32; 3]) -> [f32; 2] {
    let [x, y, z] = direction;
    let scale = 1.0 / (x.abs() + y.abs() + z.abs());
    let [p, q] = [x * scale, y * scale];
    if z < 0.0 { [(1.0 - q.abs()).copysign(x), (1.0 - p.abs()).copysign(y)] } else { [p, q] }
}

/// Unit direction of octahedral coordinates in [−1, 1]²; the inverse of [`octahedral_encode`].
#[inline]
pub fn octahedral_decode(square: [f32; 2]) -> [f32; 3] {
    let [p, q] = square;
    let z = 1.0 - p.abs() - q.abs();
    let [x, y] = if z < 0.0 { [(1.0 - q.abs()).copysign(p), (1.0 - p.abs()).copysign(q)] } else { [p, q] };
    let scale = 1.0 / (x * x + y * y + z * z).sqrt();
    [x * scale, y * scale, z * scale]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of points of the unit square that hits centre, rim, corners and diagonals.
    fn square_points() -> impl Iterator<Item = [f32; 2]> {
        (0..=64).flat_map(|j| (0..=64).map(move |i| [i as f32 / 64.0, j as f32 / 64.0]))
    }

    #[test]
    fn square_axes_point_where_the_specification_says() {
        for (square, direction) in [
            ([0.5, 0.5], [0.0, 0.0, 1.0]),
            ([1.0, 0.5], [1.0, 0.0, 0.0]),
            ([0.0, 0.5], [-1.0, 0.0, 0.0]),
            ([0.5, 1.0], [0.0, 1.0, 0.0]),
            ([0.5, 0.0], [0.0, -1.0, 0.0]),
            ([1.0, 1.0], [0.5f32.sqrt(), 0.5f32.sqrt(), 0.0]),
            ([0.0, 1.0], [-(0.5f32.sqrt()), 0.5f32.sqrt(), 0.0]),
        ] {
            let got = direction_of(square);
            for axis in 0..3 {
                assert!((got[axis] - direction[axis]).abs() < 1e-6, "{square:?}: {got:?}, wanted {direction:?}");
            }
        }
    }

    #[test]
    fn directions_are_unit_and_their_squares_come_back() {
        for square in square_points() {
            let direction = direction_of(square);
            let length: f32 = direction.iter().map(|c| c * c).sum::<f32>().sqrt();
            assert!((length - 1.0).abs() < 1e-6, "{square:?}: length {length}");
            let back = square_of(direction);
            // A few ulp of 1 through sin_cos and atan.
            assert!((0..2).all(|k| (back[k] - square[k]).abs() < 2e-6), "{square:?} came back as {back:?}");
        }
    }

    #[test]
    fn equal_areas_of_the_square_are_equal_solid_angles() {
        // Solid angle of each cell of a 7 × 7 grid by the vector area rule on 32 × 32 spherical quads.
        const N: usize = 7;
        const FINE: usize = 32;
        let solid_angle = |a: [f32; 3], b: [f32; 3], c: [f32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| v.map(f64::from));
            let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
            let triple = a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0]);
            2.0 * triple.atan2(1.0 + dot(a, b) + dot(b, c) + dot(c, a))
        };
        let wanted = std::f64::consts::TAU / (N * N) as f64;
        for cell in 0..N * N {
            let corner = |i: usize, j: usize| {
                let at = |k: usize, fine: usize| (k as f32 + fine as f32 / FINE as f32) / N as f32;
                direction_of([at(cell % N, i), at(cell / N, j)])
            };
            let mut sum = 0.0;
            for (i, j) in (0..FINE * FINE).map(|k| (k % FINE, k / FINE)) {
                let quad = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                sum += solid_angle(quad[0], quad[1], quad[2]) + solid_angle(quad[0], quad[2], quad[3]);
            }
            // Chords instead of the map's curves at the cell's rim: second order in 1/32.
            assert!((sum / wanted - 1.0).abs() < 2e-3, "cell {cell}: {sum} sr, wanted {wanted} sr");
        }
    }

    #[test]
    fn grid_index_is_row_times_n_plus_column() {
        let grid = direction_grid(5);
        assert_eq!(grid.len(), 25);
        assert_eq!(grid[12], [0.0, 0.0, 1.0]);
        assert!(grid[14][0] > 0.8 && grid[14][1].abs() < 1e-6, "last column of the middle row looks along +x");
        assert!(grid[22][1] > 0.8 && grid[22][0].abs() < 1e-6, "middle column of the last row looks along +y");
    }

    #[test]
    fn taps_are_a_partition_of_unity_that_reproduces_centres() {
        for boundary in [Boundary::Repeat, Boundary::Clamp] {
            for n in [1, 2, 3, 15] {
                for step in -40..=80 {
                    let coord = step as f32 / 40.0;
                    let pair = taps(coord, n, boundary);
                    assert!((pair[0].1 + pair[1].1 - 1.0).abs() < 1e-6);
                    assert!(pair.iter().all(|&(k, w)| k < n && (0.0..=1.0).contains(&w)), "{coord} of {n}: {pair:?}");
                }
                for k in 0..n {
                    let [(first, a), (second, b)] = taps((k as f32 + 0.5) / n as f32, n, boundary);
                    let at_k = if first == k { a } else { 0.0 } + if second == k { b } else { 0.0 };
                    assert!((at_k - 1.0).abs() < 1e-5, "centre {k} of {n}: {at_k}");
                }
            }
        }
    }

    #[test]
    fn the_rim_wraps_or_holds() {
        assert_eq!(taps(0.0, 4, Boundary::Repeat), [(3, 0.5), (0, 0.5)]);
        assert_eq!(taps(1.0, 4, Boundary::Repeat), [(3, 0.5), (0, 0.5)]);
        assert_eq!(taps(0.9375, 4, Boundary::Repeat), [(3, 0.75), (0, 0.25)]);
        assert_eq!(taps(0.0, 4, Boundary::Clamp), [(0, 1.0), (1, 0.0)]);
        assert_eq!(taps(1.0, 4, Boundary::Clamp), [(3, 1.0), (3, 0.0)]);
        assert_eq!(taps(0.25, 4, Boundary::Clamp), [(0, 0.5), (1, 0.5)]);
    }

    #[test]
    fn a_direction_table_is_read_exactly_at_its_centres() {
        for n in [1, 2, 7, 15] {
            for (index, direction) in direction_grid(n).into_iter().enumerate() {
                let at: f32 = angular_taps(direction, n).iter().filter(|tap| tap.0 == index).map(|tap| tap.1).sum();
                assert!((at - 1.0).abs() < 1e-4, "cell {index} of {n}²: weight {at}");
            }
        }
    }

    #[test]
    fn octahedral_coordinates_come_back_over_the_whole_sphere() {
        for square in square_points() {
            let up = direction_of(square);
            for direction in [up, [up[0], up[1], -up[2]]] {
                let square = octahedral_encode(direction);
                assert!(square.iter().all(|c| c.abs() <= 1.0));
                let back = octahedral_decode(square);
                assert!((0..3).all(|k| (back[k] - direction[k]).abs() < 1e-6), "{direction:?} came back as {back:?}");
            }
        }
    }
}
