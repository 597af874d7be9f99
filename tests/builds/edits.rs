//! Random sequences of edits: incremental builds against clean ones, byte for byte, and against a model of what must run.

use std::collections::{BTreeMap, BTreeSet};

use farfield::io::heights::encode_png16;
use farfield::math::rng::Stream;

use crate::project::Project;
use crate::workshop::{DIFFUSE, GLOSSY, Surface, build, ran, stripes};

/// The state of a project: what the manifest says, and which of two contents a file has.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct State {
    surface: Surface,
    map: usize,
    colors: usize,
    /// What nothing depends on.
    comment: u64,
}

/// The height map.
const MAP: &str = "map.png";

impl State {
    const FIRST: Self =
        Self { surface: Surface { height: MAP, levels: "[16]", ..Surface::PLAIN }, map: 0, colors: 0, comment: 0 };

    /// One edit; nine kinds, each of which may undo itself later.
    fn edit(&mut self, random: &mut impl FnMut(usize) -> usize) {
        let Self { surface, map, colors, comment } = self;
        match random(9) {
            0 => *map = 1 - *map,
            1 => *colors = 1 - *colors,
            2 => surface.color = if surface.color.is_none() { Some("color.png") } else { None },
            3 => surface.bsdf = if surface.bsdf == DIFFUSE { GLOSSY } else { DIFFUSE },
            4 => surface.rank = 3 - surface.rank,
            5 => surface.levels = if surface.levels == "[16]" { "[16, 32]" } else { "[16]" },
            6 => surface.name = if surface.name == "waves" { "sea" } else { "waves" },
            7 => surface.error = if surface.error == "0.03" { "0.05" } else { "0.03" },
            _ => *comment += 1,
        }
    }

    /// Makes the project so.
    fn write(&self, project: &Project) {
        project.write(MAP, &map(self.map));
        project.write("color.png", &stripes([[200, 120, 40], [40, 120, 200]][self.colors]));
        let manifest = format!("# edition {}\n{}", self.comment, self.surface.manifest());
        project.write("farfield.toml", manifest.as_bytes());
    }

    /// What the asset depends on.
    fn asset(&self) -> String {
        format!("{:?}", (&self.surface, self.map, self.used_colors()))
    }

    fn used_colors(&self) -> Option<usize> {
        self.surface.color.map(|_| self.colors)
    }

    /// The model: every action of a clean build, by name, with all that its outputs depend on. `coarse` depends on the
    /// smoothed heights, which are those of `downsample` as long as they do not fold, as here.
    fn actions(&self) -> BTreeMap<String, String> {
        let (surface, map, colors) = (&self.surface, self.map, self.used_colors());
        let mut actions = BTreeMap::from([("heights".into(), format!("{map}")), ("asset".into(), self.asset())]);
        if let Some(colors) = colors {
            // The colour map is brought to the size of the height map, which is the same for both.
            actions.insert("colors".into(), format!("{colors}"));
        }
        let factors: &[usize] = if surface.levels == "[16]" { &[16] } else { &[16, 32] };
        for (level, factor) in (1..).zip(factors) {
            let mut add = |stage: &str, depends: String| actions.insert(format!("level {level} {stage}"), depends);
            add("downsample", format!("{:?}", (map, factor)));
            add("lobes", format!("{:?}", (map, factor)));
            // of which the numbers of cells are the same for both maps
            add("choose", format!("{:?}", (factor, surface.rank)));
            add("fine", format!("{:?}", (map, colors, surface.bsdf)));
            add("smooth", format!("{:?}", (map, colors, factor, surface.bsdf)));
            add("coarse", format!("{:?}", (map, colors, factor, surface.bsdf)));
            add("fit", format!("{:?}", (map, colors, factor, surface.bsdf, surface.rank)));
            add("measure", format!("{:?}", (map, colors, factor, surface.bsdf, surface.rank)));
            if let Some(colors) = colors {
                add("tint", format!("{:?}", (colors, factor)));
            }
        }
        actions
    }
}

/// One of two maps of 128²: bumps that tile, and others.
fn map(which: usize) -> Vec<u8> {
    let wave = |i: u32, cycles: f64| (std::f64::consts::TAU * cycles * f64::from(i) / 128.0).sin();
    let cycles = [2.0, 3.0][which];
    let code = |u, v| ((wave(u, cycles) + wave(v, 2.0) + 2.0) / 4.0 * 65535.0).round() as u16;
    let codes: Vec<u16> = (0..128 * 128).map(|i| code(i % 128, i / 128)).collect();
    encode_png16(&codes, 128, 128)
}

/// The stages of an action's name and what it depends on: an action is the same in whatever level it occurs.
fn identity((name, depends): (&String, &String)) -> (String, String) {
    (name.rsplit(' ').next().unwrap().into(), depends.clone())
}

/// Runs `sequences` sequences of up to six edits, a build after each of the last two; their store is one and the same.
fn check(sequences: u64) {
    let project = Project::empty();
    let mut seen: BTreeSet<(String, String)> = BTreeSet::new();
    let mut clean: BTreeMap<String, Vec<(String, Vec<u8>)>> = BTreeMap::new();
    let mut state = State::FIRST;
    for sequence in 0..sequences {
        let stream = Stream::new(sequence, 4711);
        let mut index = 0;
        let mut random = |n: usize| {
            index += 1;
            ((stream.uniform(index) * n as f32) as usize).min(n - 1)
        };
        let edits = 1 + random(6);
        for edit in 0..edits {
            state.edit(&mut random);
            if edit + 2 < edits {
                continue;
            }
            state.write(&project);
            let said = build(&project, &[]);
            let actions = state.actions();
            let must: BTreeSet<(String, String)> =
                actions.iter().map(identity).filter(|id| !seen.contains(id)).collect();
            let did: BTreeSet<(String, String)> =
                ran(&said).iter().map(|name| identity((name, &actions[name]))).collect();
            // What has given the same bytes under another rank stops the ripple: the model cannot know.
            let stopped = must.difference(&did).filter(|(stage, _)| stage != "measure").collect::<Vec<_>>();
            assert_eq!((stopped, did.difference(&must).count()), (vec![], 0), "{sequence}: {state:?}: {did:?}");
            seen.extend(must);
        }
        let folder = format!("lod/{}", state.surface.name);
        let incremental = project.tree(&folder);
        let wanted = clean.entry(state.asset()).or_insert_with(|| {
            let alone = Project::empty();
            state.write(&alone);
            build(&alone, &["--jobs", "1"]);
            alone.tree(&folder)
        });
        assert_eq!(&incremental, wanted, "{sequence}: {state:?}");
    }
    println!("{sequences} sequences, {} assets", clean.len());
}

#[test]
fn incremental_builds_equal_clean_ones_over_a_few_edits() {
    check(4);
}

#[test]
#[ignore = "four minutes: 200 sequences"]
fn incremental_builds_equal_clean_ones_over_two_hundred_sequences_of_edits() {
    check(200);
}
