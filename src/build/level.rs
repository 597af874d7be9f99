//! One level from the input to bytes that were read again and measured.

use formats::asset::{LevelError, SurfaceAsset, SurfaceLevel};

use super::clock::StageClock;
use super::encode::{self, level_of_map, surface_asset};
use super::level_error::{Reference, measure};
use super::{Input, SurfaceSpec};
use crate::prefilter::surface::{LevelSettings, compile};

/// A level with what it cost and reached.
#[derive(Clone, Debug)]
pub(crate) struct BuiltLevel {
    /// The level, as it goes into the asset.
    pub level: SurfaceLevel,
    /// ε below 75° of the fit at its own nodes.
    pub on_node: f64,
    /// ε below 75° that was predicted when sizes were chosen.
    pub predicted: Option<f64>,
    /// The measured error.
    pub error: LevelError,
    pub(crate) clock: StageClock,
}

/// Compiles level `index` of `spec` and measures what its bytes say; what `clock` counted before is counted with it.
///
/// Where the sizes of the tables were chosen for a target that the level then misses, it is compiled once more for a lower
/// one. The error is one line.
pub(crate) fn build_level(
    spec: &SurfaceSpec,
    input: &Input,
    index: usize,
    mut clock: StageClock,
    on_stage: &mut dyn FnMut(&'static str),
) -> Result<BuiltLevel, String> {
    let settings = &spec.levels[index - 1];
    let mut enter = |clock: &mut StageClock, stage| {
        clock.begin(stage);
        on_stage(stage);
    };
    let mut aim = settings.error;
    loop {
        let aimed = LevelSettings { error: aim, ..*settings };
        let coarse = compile(&input.fine, &aimed, &mut |stage| enter(&mut clock, stage));
        let (on_node, predicted) = (coarse.on_node, coarse.predicted);
        enter(&mut clock, "encode");
        let level = level_of_map(index, input.fine.heights.size(), coarse);
        let asset = surface_asset(spec, &input.sources(), vec![level]);
        let decoded = through_bytes(&asset)?;
        enter(&mut clock, "measure");
        let error = measure(&reference(input, &decoded, on_node, settings.seed), &decoded.levels[0]);
        clock.end();
        if aim == settings.error
            && let Some(lower) = lower_aim(aim, predicted, error.below_75.value)
        {
            aim = lower;
            continue;
        }
        let [level] = <[SurfaceLevel; 1]>::try_from(asset.levels).map_err(|_| "one level went in".to_string())?;
        let level = SurfaceLevel { error: Some(error), ..level };
        return Ok(BuiltLevel { level, on_node, predicted, error, clock });
    }
}

/// What the levels of `decoded` are measured against.
pub(crate) fn reference<'a>(input: &'a Input, decoded: &'a SurfaceAsset, on_node: f64, seed: u64) -> Reference<'a> {
    Reference {
        fine: &input.fine,
        bsdf: &decoded.bsdf,
        light: decoded.light,
        size: decoded.size,
        boundary: decoded.boundary,
        on_node,
        seed,
    }
}

/// What to aim at once more, where sizes were chosen that should have reached `target` and did not.
///
/// The prediction is of direct light and knows nothing of bins and prototypes; it is trusted again in proportion. Once
/// only: a level that misses half of its target is limited by other things than the sizes of its tables.
pub(super) fn lower_aim(target: f64, predicted: Option<f64>, measured: f64) -> Option<f64> {
    let was_reached = predicted.is_some_and(|predicted| predicted <= target);
    (measured > target && was_reached).then(|| target * (target / measured).clamp(0.5, 0.9))
}

/// The asset as its reader sees it.
pub(crate) fn through_bytes(asset: &SurfaceAsset) -> Result<SurfaceAsset, String> {
    asset.encode().and_then(|files| encode::decoded(&files)).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missed_target_is_aimed_at_once_more_and_lower() {
        assert_eq!(lower_aim(0.03, Some(0.02), 0.04), Some(0.03 * 0.75));
        // met, not predicted to be met, nothing chosen
        assert_eq!(lower_aim(0.03, Some(0.02), 0.03), None);
        assert_eq!(lower_aim(0.03, Some(0.04), 0.05), None);
        assert_eq!(lower_aim(0.03, None, 0.05), None);
    }
}
