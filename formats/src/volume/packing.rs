//! The lobes of a voxel as bytes.
//!
//! A lobe is kept as the symmetric root M of its matrix, the area fraction multiplied in: φ_j·σ_j(ω) = |M_j ω|, and the phase
//! function of a lobe does not see its scale. So fractions need no bytes, every M gives a valid S = M², and rounding M by δ
//! changes the projected area by |δω| at most, however thin a fibre is. The six numbers of S itself, or its standard
//! deviations and correlations, would lose a fibre's width to a rounding of 1/255: there the square of the area is rounded.

use crate::sggx::{FlakeLobe, Sggx};
use crate::symmetric::{Eigen, square};

/// Least eigenvalue of S over its trace: S = M² + MIN_SHAPE·tr(M²)·1. Keeps a rounded M from losing a dimension.
pub const MIN_SHAPE: f64 = 1e-4;

/// Code of 0 outside of the diagonal.
const ZERO: u8 = 128;
/// Codes from 0 to the largest magnitude, ½, outside of the diagonal.
const HALF_RANGE: f64 = 127.0;

/// The codes of a lobe that a voxel does not use.
pub(super) const UNUSED: [u8; 6] = [0, 0, 0, ZERO, ZERO, ZERO];

/// A voxel's lobes as codes.
pub(super) struct Packed {
    /// ρ for the lobes as their codes say, 1/m.
    pub(super) density: f64,
    /// M_xx, M_yy, M_zz, M_xy, M_xz, M_yz of each lobe.
    pub(super) codes: Vec<[u8; 6]>,
}

/// The codes of a voxel; `None` where none of its flakes show any area.
///
/// The common scale of all M is chosen so that they fill the codes: |M_xy| ≤ ½·λmax for positive semidefinite M, and the
/// largest of M_xx and 2|M_xy| becomes 1. ρ takes what was divided out, and what rounding changed: the sum of the lobes' root
/// mean square areas, √(tr S/3), stays as it is.
pub(super) fn pack(density: f32, lobes: impl Iterator<Item = FlakeLobe>) -> Option<Packed> {
    let lobes: Vec<(f64, [f64; 6])> = lobes.map(root).collect();
    let scale = lobes.iter().flat_map(|(_, m)| (0..6).map(|k| if k < 3 { m[k] } else { 2.0 * m[k].abs() }));
    let scale = scale.fold(0.0, f64::max);
    // Written so that NaN fails too.
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let code = |m: [f64; 6]| -> [u8; 6] {
        std::array::from_fn(|k| match k {
            0..3 => (m[k] / scale * 255.0).round() as u8,
            _ => (f64::from(ZERO) + m[k] / scale * 2.0 * HALF_RANGE).round() as u8,
        })
    };
    let codes: Vec<[u8; 6]> = lobes.iter().map(|&(area, m)| if area > 0.0 { code(m) } else { UNUSED }).collect();
    let was: f64 = lobes.iter().map(|(area, _)| area).sum();
    let is: f64 = codes.iter().map(|&codes| trace(matrix_of(codes)).sqrt()).sum();
    Some(Packed { density: f64::from(density) * was / is, codes })
}

/// φ·√(tr S), and φ·M.
fn root(lobe: FlakeLobe) -> (f64, [f64; 6]) {
    if lobe.area <= 0.0 {
        return (0.0, [0.0; 6]);
    }
    let area = f64::from(lobe.area);
    let s = lobe.shape.matrix().map(f64::from);
    let least = MIN_SHAPE * trace(s) / (1.0 + 3.0 * MIN_SHAPE);
    let m = Eigen::of(s).map(|value| (value - least).max(0.0).sqrt());
    (area * trace(s).sqrt(), m.map(|value| area * value))
}

/// S of a lobe's codes, area fraction included; 0 for an unused one.
fn matrix_of(codes: [u8; 6]) -> [f64; 6] {
    let m: [f64; 6] = std::array::from_fn(|k| match k {
        0..3 => f64::from(codes[k]) / 255.0,
        _ => (f64::from(codes[k]) - f64::from(ZERO)) / (2.0 * HALF_RANGE),
    });
    let mut s = square(m);
    let least = MIN_SHAPE * trace(s);
    s[..3].iter_mut().for_each(|value| *value += least);
    s
}

fn trace(s: [f64; 6]) -> f64 {
    s[0] + s[1] + s[2]
}

/// The lobes of a voxel's codes, with `albedos`; areas sum to 1, and all S have the same trace. `None` where no lobe is used.
pub(super) fn unpack(codes: &[[u8; 6]], albedos: impl Iterator<Item = [f32; 3]>) -> Option<Vec<FlakeLobe>> {
    let matrices: Vec<[f64; 6]> = codes.iter().map(|&codes| matrix_of(codes)).collect();
    let total: f64 = matrices.iter().map(|&s| trace(s).sqrt()).sum();
    if total <= 0.0 {
        return None;
    }
    let lobe = |(s, albedo): (&[f64; 6], [f32; 3])| {
        let area = trace(*s).sqrt() / total;
        let unused = FlakeLobe { area: 0.0, shape: Sggx::ISOTROPIC, albedo: [0.0; 3] };
        if area <= 0.0 {
            return unused;
        }
        let shape = Sggx::from_matrix(s.map(|value| (value / (area * area)) as f32));
        FlakeLobe { area: area as f32, shape: shape.expect("eigenvalues of MIN_SHAPE at least"), albedo }
    };
    Some(matrices.iter().zip(albedos).map(lobe).collect())
}

/// Density and lobes that a reader finds in place of these, albedos and half floats aside; for voxels that
/// [`super::VolumeAsset::encode`] takes.
pub fn quantised_voxel(density: f32, lobes: &[FlakeLobe]) -> Option<(f32, Vec<FlakeLobe>)> {
    let packed = pack(density, lobes.iter().copied())?;
    let lobes = unpack(&packed.codes, lobes.iter().map(|lobe| lobe.albedo))?;
    Some((packed.density as f32, lobes))
}

/// Range of the albedo of one lobe in a level, `[low, high][channel]`; codes are fractions of it.
pub(super) type AlbedoRange = [[f32; 3]; 2];

/// The smallest range that holds all of `albedos`; 0 where there is none.
pub(super) fn albedo_range(albedos: impl Iterator<Item = [f32; 3]>) -> AlbedoRange {
    let wider = |range: Option<AlbedoRange>, rgb: [f32; 3]| {
        let [low, high] = range.unwrap_or([rgb; 2]);
        Some([0, 1].map(|end| std::array::from_fn(|c| if end == 0 { low[c].min(rgb[c]) } else { high[c].max(rgb[c]) })))
    };
    albedos.fold(None, wider).unwrap_or([[0.0; 3]; 2])
}

/// Codes of an albedo in `range`. `carry` is what the voxels before in the same brick were rounded by: added, so that the
/// mean albedo of a brick is kept to a code over its voxels, which multiple scattering needs.
pub(super) fn albedo_codes(rgb: [f32; 3], range: &AlbedoRange, carry: &mut [f64; 3]) -> [u8; 3] {
    std::array::from_fn(|c| {
        let [low, high] = [0, 1].map(|end: usize| f64::from(range[end][c]));
        if high <= low {
            return 0;
        }
        let exact = (f64::from(rgb[c]) - low) / (high - low) * 255.0 + carry[c];
        let code = exact.round().clamp(0.0, 255.0);
        carry[c] = exact - code;
        code as u8
    })
}

/// The albedo of codes in `range`; within it, rounding included.
pub(super) fn albedo_of(codes: [u8; 3], range: &AlbedoRange) -> [f32; 3] {
    std::array::from_fn(|c| {
        let [low, high] = [0, 1].map(|end: usize| f64::from(range[end][c]));
        (low + (high - low) * f64::from(codes[c]) / 255.0) as f32
    })
}
