//! The results that a surface's actions take, by what they are.

use std::sync::Arc;

use crate::build::action::{Failure, Need, Record};
use crate::build::artifact::Artifact;
use crate::geometry::HeightField;
use crate::material::Brdf;
use crate::prefilter::surface::coarse::CoarseSurface;
use crate::prefilter::surface::reflectance::PatchReflectance;
use crate::prefilter::surface::{Choice, FineSurface, FineTables, LevelFit, VmfLobe};
use formats::asset::LevelError;

/// Texels of the map that the first need read.
pub(super) fn size_of(needs: &[Arc<Record>]) -> [usize; 2] {
    needs.first().and_then(|need| need.facts.size).unwrap_or([1, 1])
}

/// The same of loaded needs.
pub(super) fn need_size(needs: &[Need]) -> Result<[usize; 2], Failure> {
    needs.first().and_then(|need| need.record.facts.size).ok_or_else(of_another_kind)
}

/// The fine surface of its heights and colours.
pub(super) fn fine_surface(map: &Need, color: Option<&Need>, brdf: &Brdf) -> Result<FineSurface, Failure> {
    let color = colors(color)?.map(<[_]>::to_vec);
    Ok(FineSurface { heights: heights(map)?.clone(), brdf: *brdf, color })
}

/// The coarse surface of its heights, lobes and colours.
pub(super) fn coarse_surface<'n>(
    [map, distributions]: [&'n Need; 2],
    tint: Option<&'n Need>,
    brdf: &'n Brdf,
    gaussians: &'n [[f32; 2]],
) -> Result<CoarseSurface<'n>, Failure> {
    let (heights, lobes, base_color) = (heights(map)?, lobes(distributions)?, colors(tint)?);
    Ok(CoarseSurface { heights, lobes, base_color, brdf, gaussians })
}

/// An artifact is not what its stage makes: no store of ours gives such a thing.
pub(super) fn of_another_kind() -> Failure {
    Failure::Refused("a stored result is of another kind than its stage makes; empty the cache, and build again".into())
}

/// Heights.
pub(super) fn heights(need: &Need) -> Result<&HeightField, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Heights(heights)) => Ok(heights),
        _ => Err(of_another_kind()),
    }
}

/// Lobes.
pub(super) fn lobes(need: &Need) -> Result<&Vec<Vec<VmfLobe>>, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Lobes(lobes)) => Ok(lobes),
        _ => Err(of_another_kind()),
    }
}

/// Colours, where there is such an action.
pub(super) fn colors(need: Option<&Need>) -> Result<Option<&[[f32; 3]]>, Failure> {
    match need.map(|need| need.artifact.as_deref()) {
        None => Ok(None),
        Some(Some(Artifact::Colors(colors))) => Ok(colors.as_deref()),
        Some(_) => Err(of_another_kind()),
    }
}

/// T and S, and the additive term.
pub(super) fn fit(need: &Need) -> Result<&LevelFit, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Fit(fit)) => Ok(fit),
        _ => Err(of_another_kind()),
    }
}

/// Sizes of tables.
pub(super) fn choice(need: &Need) -> Result<&Choice, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Choice(choice)) => Ok(choice),
        _ => Err(of_another_kind()),
    }
}

/// The measured error.
pub(super) fn error(need: &Need) -> Result<LevelError, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Error(error)) => Ok(*error),
        _ => Err(of_another_kind()),
    }
}

/// F of the fine surface.
pub(super) fn fine_f(need: &Need) -> Result<&FineTables, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Fine(tables)) => Ok(tables),
        _ => Err(of_another_kind()),
    }
}

/// F of the coarse surface.
pub(super) fn table(need: &Need) -> Result<&PatchReflectance, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Reflectance(table)) => Ok(table),
        _ => Err(of_another_kind()),
    }
}
