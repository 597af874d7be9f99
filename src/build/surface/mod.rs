//! A surface as actions: one that reads its heights, the stages of every level, one that puts the asset together.
//!
//! ```text
//! heights ─┬─► downsample ─┬─► choose ─► fine ─► smooth ─► coarse ─► fit ─► measure ─► asset     for every level
//!          └─► lobes ──────┘
//! colors ────► tint: mean colours of a level's cells, for all from `choose` on
//! ```
//!
//! Levels whose tables have the same sizes share `fine`. Where sizes were chosen for a target that `measure` then finds
//! missed, `retune` chooses once more for a lower one, and all from `fine` on follows again; where it was met, `retune`
//! gives what `choose` gave, and what follows is known.
//!
//! The key of `asset` is made of what the whole surface depends on, files and settings alone. So whether anything is to
//! be done is known without a look at the graph.

mod assemble;
mod needs;
mod settings;
mod steps;

use std::path::Path;

use super::SurfaceSpec;
use super::graph::{ActionId, Graph, Place};
use super::key::{Digest, Walk};
use crate::prefilter::surface::LevelSettings;
use settings::{ASSET, Open, version_of};
pub use steps::SurfaceStep;

/// The digests of a surface's files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfaceFiles {
    /// Of the height map.
    pub height: Digest,
    /// Of the colour map.
    pub color: Option<Digest>,
}

/// Everything that the asset of a surface depends on.
pub fn walk_asset(spec: &SurfaceSpec, files: SurfaceFiles) -> Walk {
    let mut walk = Walk::new(ASSET, version_of(ASSET));
    // Taken apart, so that no setting is forgotten that comes later. Paths are no part of what is made.
    let SurfaceSpec {
        name,
        height: _,
        channel,
        invert,
        size,
        amplitude,
        offset,
        boundary,
        brdf,
        color: _,
        detrend,
        dequantize,
        levels,
    } = spec;
    settings::walk_versions(&mut walk);
    walk.input("height map", files.height);
    if let Some(color) = files.color {
        walk.input("colour map", color);
    }
    walk.setting("name", name);
    walk.setting("channel", channel);
    walk.setting("invert", invert);
    walk.setting("size", size);
    walk.setting("amplitude", amplitude);
    walk.setting("offset", offset);
    walk.setting("boundary", boundary);
    settings::walk_brdf(&mut walk, brdf);
    walk.setting("detrend", detrend);
    walk.setting("dequantize", dequantize);
    walk.setting("levels", levels.iter().map(|level| level.factor).collect::<Vec<_>>());
    for (number, level) in (1..).zip(levels) {
        let LevelSettings { factor: _, patches, directions, rank, lobes, light, error, seed } = level;
        let mut set = |name: &str, value: &dyn std::fmt::Debug| walk.setting(&format!("level {number} {name}"), value);
        set("patches", &Open(*patches));
        set("directions", &Open(*directions));
        set("rank", &Open(*rank));
        set("lobes", &Open(*lobes));
        set("light", light);
        set("error", error);
        set("seed", seed);
    }
    walk
}

/// Adds the actions of `spec`, whose paths are relative to `folder`, to `graph` as those of asset number `asset`; the last
/// one.
pub fn add<'a>(
    graph: &mut Graph<SurfaceStep<'a>>,
    asset: usize,
    spec: &'a SurfaceSpec,
    files: SurfaceFiles,
    folder: &Path,
) -> ActionId {
    let place = |level| Place { asset, level };
    let path = folder.join(&spec.height);
    let heights = graph.push(SurfaceStep::Heights { spec, path, digest: files.height }, place(0), vec![]);
    let colors = spec.color.as_ref().zip(files.color).map(|(color, digest)| {
        graph.push(SurfaceStep::Colors { path: folder.join(color), digest }, place(0), vec![heights])
    });
    let levels: Vec<LevelActions> = (1..)
        .zip(&spec.levels)
        .map(|(number, settings)| LevelActions::add(graph, place(number), spec, settings, [Some(heights), colors]))
        .collect();
    let mut needs = vec![heights];
    needs.extend(colors);
    needs.extend(levels.iter().flat_map(LevelActions::all));
    graph.push(SurfaceStep::Asset { spec, files }, place(spec.levels.len()), needs)
}

/// The actions of one level.
struct LevelActions {
    before: Vec<ActionId>,
    rounds: Vec<Round>,
    lobes: ActionId,
    tint: Option<ActionId>,
}

/// The actions of a level that depend on the sizes of its tables.
#[derive(Clone, Copy)]
struct Round {
    sizes: ActionId,
    fine: ActionId,
    smooth: ActionId,
    coarse: ActionId,
    fit: ActionId,
    measure: ActionId,
}

impl LevelActions {
    fn add<'a>(
        graph: &mut Graph<SurfaceStep<'a>>,
        place: Place,
        spec: &'a SurfaceSpec,
        settings: &'a LevelSettings,
        [heights, colors]: [Option<ActionId>; 2],
    ) -> Self {
        let mut push =
            |step, needs: &[Option<ActionId>]| graph.push(step, place, needs.iter().flatten().copied().collect());
        let brdf = &spec.brdf;
        let downsample = push(SurfaceStep::Downsample { settings }, &[heights]);
        let lobes = push(SurfaceStep::Lobes { settings }, &[heights]);
        let tint = colors.map(|_| push(SurfaceStep::Tint { settings }, &[heights, colors]));
        let [own_downsample, own_lobes] = [Some(downsample), Some(lobes)];
        let is_open = !settings::is_fixed(settings);
        let choose = SurfaceStep::Choose { settings, brdf };
        let mut sizes = if is_open {
            push(choose, &[heights, own_downsample, own_lobes, colors, tint])
        } else {
            push(choose, &[heights])
        };
        let mut rounds: Vec<Round> = Vec::new();
        loop {
            let own_sizes = Some(sizes);
            let fine = push(SurfaceStep::Fine { settings, brdf }, &[heights, own_sizes, colors]);
            let smooth = SurfaceStep::Smooth { settings, brdf };
            let smooth = push(smooth, &[heights, own_downsample, own_lobes, own_sizes, Some(fine), tint]);
            let coarse = push(SurfaceStep::Coarse { settings, brdf }, &[Some(smooth), own_lobes, own_sizes, tint]);
            let fit = SurfaceStep::Fit { settings };
            let fit = push(fit, &[Some(smooth), Some(fine), Some(coarse), own_sizes]);
            let measure = SurfaceStep::Measure { settings, spec };
            let measure = push(measure, &[heights, Some(smooth), own_lobes, own_sizes, Some(fit), colors, tint]);
            rounds.push(Round { sizes, fine, smooth, coarse, fit, measure });
            if !is_open || rounds.len() == 2 {
                break;
            }
            let retune = SurfaceStep::Retune { settings, brdf };
            sizes = push(retune, &[heights, own_downsample, own_lobes, own_sizes, Some(measure), colors, tint]);
        }
        Self { before: vec![downsample], rounds, lobes, tint }
    }

    /// All, in the order in which `asset` takes them: what the level is made of first, see [`assemble`].
    fn all(&self) -> impl Iterator<Item = ActionId> {
        let Round { sizes, fine, smooth, coarse, fit, measure } = *self.rounds.last().expect("one round at least");
        let earlier = self.rounds[..self.rounds.len() - 1].iter();
        let earlier =
            earlier.flat_map(|round| [round.sizes, round.fine, round.smooth, round.coarse, round.fit, round.measure]);
        let made_of = [self.lobes, sizes, smooth, fit, measure].into_iter().chain(self.tint);
        made_of.chain([fine, coarse]).chain(self.before.iter().copied()).chain(earlier)
    }
}
