//! A grid file: its path, or a table with the path and, for a bare array, what it holds.

use super::super::fields::{Fields, numbers};
use super::named;
use crate::io::grid::{RawLayout, SampleType};

/// A grid on disk.
#[derive(Clone, Debug, PartialEq)]
pub struct GridSpec {
    /// Its path, relative to the manifest.
    pub file: String,
    /// What a bare array holds; `None` for files that say so themselves.
    pub layout: Option<RawLayout>,
}

/// What a grid may be, for messages.
pub(super) const GRID: &str = "the path of a `.vol` file or TIFF stack, or a table with `file`";

/// The grid `key`: a path or a table.
pub(super) fn read_grid(fields: &mut Fields<'_, '_, '_, '_>, key: &'static str, wanted: &str) -> Option<GridSpec> {
    read_grid_with(fields, key, wanted, &mut |_| ())
}

/// The grid `key`; where it is a table, `more` reads the other keys of it.
pub(super) fn read_grid_with(
    fields: &mut Fields<'_, '_, '_, '_>,
    key: &'static str,
    wanted: &str,
    more: &mut dyn FnMut(&mut Fields<'_, '_, '_, '_>),
) -> Option<GridSpec> {
    let (_, value) = fields.raw(key)?;
    if !value.get_ref().is_table() {
        return fields.text(key, wanted).map(|file| GridSpec { file, layout: None });
    }
    let read = fields.table(key, |table| {
        let grid = read_keys(table, "file");
        more(table);
        grid
    });
    read.flatten()
}

/// The grid whose path is `file` and whose layout stands beside it.
pub(super) fn read_keys(fields: &mut Fields<'_, '_, '_, '_>, file: &'static str) -> Option<GridSpec> {
    const SIZE: &str = "the voxels of a bare array along x, y and z, as in `[128, 128, 64]`";
    const TYPE: &str = "the type of a bare array, one of `\"u8\"`, `\"u16\"`, `\"i16\"`, `\"f16\"`, `\"f32\"`";
    fields.require(file, GRID);
    let path = fields.text(file, "the path of a grid");
    let is_bare = ["size", "type", "order", "endian"].iter().any(|key| fields.has(key));
    if is_bare {
        fields.require("size", SIZE);
        fields.require("type", TYPE);
    }
    let size = fields.value("size", SIZE, |value| {
        let whole = |n: &f64| n.fract() == 0.0 && (1.0..=1e9).contains(n);
        <[f64; 3]>::try_from(numbers(value)?)
            .ok()
            .filter(|size| size.iter().all(whole))
            .map(|size| size.map(|n| n as u64))
    });
    let sample = fields.value("type", TYPE, |value| named(value.as_str()?, &SampleType::NAMES));
    let wanted = "the axes from the fastest to the slowest, as in `\"xyz\"` or `\"zyx\"`";
    let order = fields.value("order", wanted, |value| read_order(value.as_str()?));
    let wanted = "`\"little\"` or `\"big\"`";
    let is_big_endian =
        fields.value("endian", wanted, |value| named(value.as_str()?, &[("little", false), ("big", true)]));
    let layout = match is_bare {
        false => None,
        true => Some(RawLayout {
            size: size?,
            sample: sample?,
            order: order.unwrap_or([0, 1, 2]),
            is_big_endian: is_big_endian.unwrap_or(false),
        }),
    };
    Some(GridSpec { file: path?, layout })
}

/// `xyz` in any order.
fn read_order(text: &str) -> Option<[usize; 3]> {
    let axes: Option<Vec<usize>> = text.chars().map(|axis| "xyz".find(axis)).collect();
    let axes = <[usize; 3]>::try_from(axes?).ok()?;
    (0..3).all(|axis| axes.contains(&axis)).then_some(axes)
}
