//! TIFF stacks: one page a slice, from the first; CT volumes come as such.

use super::{Grid, MAX_VOXELS, checked_size};
use crate::io::tiff_image::{Pages, open};
use crate::io::{Error, SourceFile};

/// Decodes all pages, which must be alike: one grey channel each.
pub(super) fn decode(file: &SourceFile) -> Result<Grid, Error> {
    let mut pages: Pages<'_> = open(file)?;
    let mut grid: Option<Grid> = None;
    loop {
        let left = MAX_VOXELS - grid.as_ref().map_or(0, |grid| grid.values.len() as u64);
        let Some(page) = pages.next_grey(left).map_err(|error| grey_wanted(file, error))? else { break };
        // Codes came as fractions: times the largest they are whole again, to a hundredth.
        let largest_code = page.bits.map(|bits| ((1u32 << bits) - 1) as f32);
        let code = |fraction: f32| largest_code.map_or(fraction, |largest| (fraction * largest).round());
        let [width, height] = [page.width, page.height];
        let grid = grid.get_or_insert(Grid { size: [width, height, 0], channels: 1, values: Vec::new(), largest_code });
        if grid.size[..2] != [width, height] || grid.largest_code != largest_code {
            let found = format!("a page {} of {width} × {height} texels unlike the first", grid.size[2] + 1);
            let wanted = "pages of one size and type";
            return Err(Error::Unsupported { file: file.name().into(), found, wanted });
        }
        grid.values.extend(page.planes[0].iter().map(|&fraction| code(fraction)));
        grid.size[2] += 1;
    }
    let grid = grid.expect("a TIFF that opens has a page");
    checked_size(file, grid.size.map(|n| n as u64))?;
    Ok(grid)
}

/// Words of a volume for a page without a grey channel.
fn grey_wanted(file: &SourceFile, error: Error) -> Error {
    match error {
        Error::Channel { found, .. } => {
            let found = format!("pages with the channels {}", found.join(", "));
            Error::Unsupported { file: file.name().into(), found, wanted: "one grey channel" }
        }
        error => error,
    }
}
