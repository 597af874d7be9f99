//! Hard maps and bases, end to end: compiled, encoded, decoded, read and measured.

mod support;

use farfield::build::encode::{self, decoded, surface_level};
use farfield::geometry::{Boundary, HeightField};
use farfield::material::{Brdf, Conductor};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport};
use formats::asset::{MAX_HALF, SurfaceAsset};
use glam::Vec3;
use support::{asset, at, both, compiled, diffuse, field, fixture, ggx, measured, random_direction, towards, waves};

/// One map with its base and settings.
struct Case {
    name: String,
    fine: FineSurface,
    settings: LevelSettings,
    /// Largest ε below 75° where the level is measured, `None` where it is only read.
    epsilon: Option<f64>,
}

impl Case {
    fn new(name: impl Into<String>, heights: HeightField) -> Self {
        let fine = FineSurface { heights, brdf: both(0.3), color: None };
        let settings = LevelSettings { directions: Some(7), patches: Some(2), ..at(8.0) };
        Self { name: name.into(), fine, settings, epsilon: None }
    }

    fn base(mut self, brdf: Brdf) -> Self {
        self.fine.brdf = brdf;
        self
    }

    fn color(mut self, color: impl Fn(usize, usize) -> [f32; 3]) -> Self {
        let [width, height] = self.fine.heights.size();
        self.fine.color = Some((0..width * height).map(|t| color(t % width, t / width)).collect());
        self
    }

    fn with(mut self, change: impl FnOnce(&mut LevelSettings)) -> Self {
        change(&mut self.settings);
        self
    }

    /// The level is measured, and ε below 75° is at most this.
    fn within(mut self, epsilon: f64) -> Self {
        self.epsilon = Some(epsilon);
        self
    }
}

/// A map that tiles or not, one metre a texel.
fn map(size: [usize; 2], height: impl Fn(usize, usize) -> f32) -> HeightField {
    field(size, [1.0; 2], Boundary::Repeat, height)
}

/// Random heights in [0, amplitude) without any smoothness.
fn noise(size: [usize; 2], amplitude: f32, boundary: Boundary) -> HeightField {
    let rng = Stream::new(2, 0);
    field(size, [1.0; 2], boundary, |i, j| amplitude * rng.uniform((j * size[0] + i) as u64))
}

/// Directions that a reader may ask for: random, vertical, at the horizon.
fn probes() -> Vec<Vec3> {
    let rng = Stream::new(41, 0);
    let grazing = 89.9_f32.to_radians();
    let mut directions: Vec<Vec3> = (0..12).map(|k| random_direction(rng, k)).collect();
    directions.extend([Vec3::Z, towards(grazing, 0.0), towards(grazing, 2.3), towards(grazing, 4.0)]);
    directions.extend([0.6, 0.6 + std::f32::consts::PI].map(|phi| towards(89.999_f32.to_radians(), phi)));
    directions
}

/// What must hold for every level as its reader finds it.
fn expect_readable(case: &Case, asset: &SurfaceAsset) {
    let (name, level) = (&case.name, &asset.levels[0]);
    for (table, values) in [("T", &level.spatial), ("S", &level.angular)] {
        for value in values.iter().flatten().flatten() {
            assert!(value.is_finite() && value.abs() <= MAX_HALF, "{name}: {table} holds {value}");
            assert!(values.len() > 1 || *value >= 0.0, "{name}: {table} holds {value}");
        }
    }
    assert!(level.heights.iter().all(|h| h.is_finite()), "{name}");
    let rng = Stream::new(42, 0);
    let probes = probes();
    for place in 0..10 {
        let x = rng.uniform_pair(place);
        let n_c = level.normal_at(asset, x);
        for (k, wi) in probes.iter().enumerate() {
            for wo in &probes[..=k] {
                let [wi, wo] = [wi.to_array(), wo.to_array()];
                let (f, g) = (level.f_low(asset, x, n_c, wi, wo), level.f_low(asset, x, n_c, wo, wi));
                for c in 0..3 {
                    assert!(f[c].is_finite() && f[c] >= 0.0, "{name}: f_low is {f:?} for {wi:?}, {wo:?} at {x:?}");
                    assert!((f[c] - g[c]).abs() <= 1e-4 * f[c].max(1e-6), "{name}: {f:?} {g:?} for {wi:?}, {wo:?}");
                }
            }
        }
    }
}

/// Compiles, encodes, decodes, reads and, where asked for, measures; returns what went wrong.
fn run(case: &Case) {
    let name = &case.name;
    let coarse = compiled(&case.fine, &case.settings);
    assert!(coarse.on_node.is_finite(), "{name}: {}", coarse.on_node);
    let on_node = coarse.on_node;
    let files = asset(&case.fine, vec![surface_level(1, &case.fine.heights, coarse)])
        .encode()
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    let mut asset = decoded(&files).unwrap_or_else(|error| panic!("{name}: {error}"));
    asset.light = encode::light(case.settings.light);
    expect_readable(case, &asset);
    let Some(bound) = case.epsilon else {
        println!("{name}: on the nodes {:.2} %", 100.0 * on_node);
        return;
    };
    let error = measured(&case.fine, &asset, 7);
    let [below, above, bias] = [error.below_75, error.above_75, error.bias].map(|figure| 100.0 * figure.value);
    println!(
        "{name}: on the nodes {:.2} %, ε {below:.2} ± {:.2} %, above 75° {above:.2} %, bias {bias:+.2} %",
        100.0 * on_node,
        100.0 * error.below_75.standard_error
    );
    for (figure, value) in error.figures() {
        assert!(value.value.is_finite() && value.standard_error.is_finite(), "{name}: {figure} is {value:?}");
    }
    assert!(error.below_75.value <= bound, "{name}: ε is {:?}, at most {bound} was stated", error.below_75);
}

fn run_all(cases: impl IntoIterator<Item = Case>) {
    cases.into_iter().for_each(|case| run(&case));
}

#[test]
fn constant_heights_stay_exact() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        let flat = |height: f32| field([40, 32], [1.0; 2], boundary, move |_, _| height);
        run_all([
            Case::new("constant 1e3", flat(1e3)),
            Case::new("constant −7, one patch", flat(-7.0)).with(|s| s.patches = Some(1)),
        ]);
    }
    run(&Case::new("constant 0, diffuse", map([40, 32], |_, _| 0.0)).base(diffuse(0.8)).within(0.002));
}

#[test]
fn a_single_spike_survives() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        let spike = |height: f32| {
            field([48, 48], [1.0; 2], boundary, move |i, j| if [i, j] == [21, 13] { height } else { 0.0 })
        };
        run_all([
            Case::new("spike of 1", spike(1.0)).base(diffuse(0.8)),
            Case::new("spike of 12", spike(12.0)),
            Case::new("spike of 12, four patches", spike(12.0)).with(|s| s.patches = Some(4)),
            Case::new("spike of 1000", spike(1000.0)),
            Case::new("hole of 30", spike(-30.0)),
        ]);
    }
    let spike = map([48, 48], |i, j| if [i, j] == [21, 13] { 12.0 } else { 0.0 });
    run(&Case::new("spike of 12, diffuse", spike).base(diffuse(0.8)).within(0.02));
}

#[test]
fn checkerboard_steps_survive() {
    let steps = |period: usize, height: f32| map([48, 48], move |i, j| ((i / period + j / period) % 2) as f32 * height);
    run_all([
        Case::new("steps of 2 every 6 texels", steps(6, 2.0)).base(diffuse(0.8)).within(0.12),
        Case::new("steps of 20 every 4 texels", steps(4, 20.0)),
        // all texel centres are level, so F_fine is a plane's while the saddles between them are not: 30 % and said so
        Case::new("a checkerboard of single vertices", steps(1, 1.0)).base(diffuse(0.8)).within(0.35),
        Case::new("a checkerboard of single vertices, not downsampled", steps(1, 1.0)).with(|s| s.factor = 1.0),
    ]);
}

#[test]
fn cliffs_of_eighty_to_one_survive() {
    let rng = Stream::new(3, 0);
    let blocks = |boundary| {
        field(
            [64, 64],
            [1.0; 2],
            boundary,
            move |i, j| {
                if rng.uniform((j / 8 * 8 + i / 8) as u64) > 0.5 { 80.0 } else { 0.0 }
            },
        )
    };
    run_all([
        // 2 × 2 patches cannot tell 64 cells apart that are all different
        Case::new("cliffs, repeated", blocks(Boundary::Repeat)).base(diffuse(0.8)).within(0.7),
        Case::new("cliffs, finite, GGX", blocks(Boundary::Clamp)),
        Case::new("cliffs, GGX 0.05", blocks(Boundary::Repeat)).base(ggx(0.05)),
        Case::new("terraces", field([64, 48], [1.0; 2], Boundary::Clamp, |i, _| 80.0 * (i / 8) as f32)),
    ]);
}

#[test]
fn grooves_of_two_colours_keep_their_colours() {
    let groove = || map([64, 32], |i, _| (i as f32 % 16.0 - 8.0).abs());
    let two = |i: usize, _: usize| if i % 16 < 8 { [1.0, 0.1, 0.0] } else { [0.0, 0.1, 1.0] };
    run_all([
        Case::new("groove of two colours, diffuse", groove())
            .base(diffuse(0.9))
            .color(two)
            .with(|s| s.directions = Some(15))
            .within(0.05),
        Case::new("groove of two colours, both", groove()).color(two),
        Case::new("groove of black and white patches", groove()).color(|i, _| [f32::from(u8::from(i < 32)); 3]),
        Case::new("groove, all black", groove()).color(|_, _| [0.0; 3]),
        Case::new("groove, one bright texel", groove()).color(|i, j| [f32::from(u8::from([i, j] == [9, 9])); 3]),
    ]);
}

#[test]
fn interreflection_survives_hard_surfaces() {
    let groove = || map([64, 32], |i, _| (i as f32 % 16.0 - 8.0).abs());
    let two = |i: usize, _: usize| if i % 16 < 8 { [1.0, 0.1, 0.0] } else { [0.0, 0.1, 1.0] };
    let cliffs = || map([32, 32], |i, _| if i % 16 < 8 { 80.0 } else { 0.0 });
    let spike = || map([32, 32], |i, j| if [i, j] == [9, 9] { 100.0 } else { 0.0 });
    let checkers = || map([32, 32], |i, j| 2.0 * ((i + j) % 2) as f32);
    let row = || field([1, 64], [1.0; 2], Boundary::Clamp, waves([1, 64], 8.0, 1.0, 6));
    let rough = |amplitude| noise([32, 32], amplitude, Boundary::Repeat);
    let cases = [
        Case::new("baked: constant", map([32, 32], |_, _| 0.7)).base(diffuse(1.0)).within(1e-4),
        Case::new("baked: groove of two colours", groove()).base(diffuse(0.9)).color(two).within(0.08),
        Case::new("baked: black groove", groove()).base(diffuse(0.0)),
        Case::new("baked: white cliffs", cliffs()).base(diffuse(1.0)),
        Case::new("baked: glossy cliffs", cliffs()),
        Case::new("baked: spike", spike()),
        Case::new("baked: checkerboard", checkers()),
        Case::new("baked: one row", row()).base(diffuse(0.8)).within(0.1),
        Case::new("baked: one texel", map([1, 1], |_, _| 0.3)),
        Case::new("baked: amplitude 1e-9", rough(1e-9)).within(0.01),
        Case::new("baked: amplitude 1000", rough(1e3)),
        Case::new("baked: GGX 0.02", rough(4.0)).base(ggx(0.02)),
        Case::new("baked: GGX 1", rough(4.0)).base(ggx(1.0)),
    ];
    // `global` has the same tables: that it passes the asset is enough
    let small = [Case::new("global: checkerboard", checkers()), Case::new("global: white cliffs", cliffs())];
    run_all(small.map(|case| case.with(|s| s.light = LightTransport::Global)));
    run_all(cases.map(|case| case.with(|s| s.light = LightTransport::Baked)));
}

#[test]
fn oblong_maps_and_texels_survive() {
    let oblong = |size: [usize; 2], spacing, boundary| field(size, spacing, boundary, waves(size, 8.0, 1.5, 6));
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        run_all([
            Case::new("texels 1 × 2.5", oblong([48, 32], [1.0, 2.5], boundary)),
            Case::new("texels 1e-5 × 1e-4", oblong([32, 48], [1e-5, 1e-4], boundary)),
            Case::new("96 × 8", oblong([96, 8], [1.0; 2], boundary)),
            Case::new("factor 3.7 of 50 × 37", oblong([50, 37], [1.0; 2], boundary)).with(|s| s.factor = 3.7),
            Case::new("1 × 64", oblong([1, 64], [1.0; 2], boundary)),
            Case::new("64 × 1", oblong([64, 1], [1.0; 2], boundary)),
            Case::new("2 × 3", oblong([2, 3], [1.0; 2], boundary)),
            Case::new("one texel", oblong([1, 1], [1.0; 2], boundary)),
        ]);
    }
    let finite = oblong([48, 32], [1.0, 2.5], Boundary::Clamp);
    run(&Case::new("texels 1 × 2.5, diffuse", finite).base(diffuse(0.8)).within(0.08));
}

#[test]
fn maps_of_one_row_are_measured_too() {
    run_all([
        Case::new("1 × 64", field([1, 64], [1.0; 2], Boundary::Repeat, waves([1, 64], 8.0, 1.0, 6)))
            .base(diffuse(0.8))
            .within(0.1),
        Case::new("64 × 1", field([64, 1], [1.0; 2], Boundary::Clamp, waves([64, 1], 8.0, 1.0, 6)))
            .base(diffuse(0.8))
            .within(0.1),
    ]);
}

#[test]
fn eight_bit_terraces_survive() {
    // Hills of a few codes: flat treads with steps of one code between them.
    let hills = waves([64, 64], 32.0, 1.0, 8);
    let terraces = map([64, 64], move |i, j| (hills(i, j) * 4.0).round() / 4.0);
    run_all([
        Case::new("terraces, diffuse", terraces.clone()).base(diffuse(0.8)).within(0.06),
        Case::new("terraces, GGX 0.1", terraces).base(ggx(0.1)),
    ]);
}

#[test]
fn threads_that_the_grid_does_not_resolve_survive() {
    // Two cells a thread: kept slopes alone fold the coarse surface so that it hides at grazing angles what the original
    // shows there, and S jumps from node to node; ε above 75° is 54 % then.
    let heights = fixture("heights/silk", 24.453);
    let fine = FineSurface { heights, brdf: ggx(0.3), color: None };
    let coarse = compiled(&fine, &LevelSettings { patches: Some(2), ..at(16.0) });
    let asset = asset(&fine, vec![surface_level(1, &fine.heights, coarse)]);
    let error = measured(&fine, &asset, 7);
    println!("threads: ε {:?}, above 75° {:?}", error.below_75, error.above_75);
    assert!(error.above_75.value < 0.2, "{:?}", error.above_75);
}

#[test]
fn amplitudes_from_zero_to_a_thousand_survive() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for amplitude in [0.0, 1e-30, 1e-9, 1e3] {
            run(&Case::new(format!("noise of amplitude {amplitude:e}"), noise([40, 40], amplitude, boundary)));
        }
    }
    let gentle = noise([40, 40], 1e-9, Boundary::Repeat);
    run(&Case::new("noise of amplitude 1e-9, diffuse", gentle).base(diffuse(0.8)).within(0.002));
    let high = |i, j| 1e6 + waves([32, 32], 8.0, 1.0, 6)(i, j);
    run(&Case::new("hills a thousand kilometres up", map([32, 32], high)));
}

#[test]
fn bases_from_mirrors_to_chalk_survive() {
    let hills = || map([40, 40], waves([40, 40], 10.0, 1.5, 6));
    let noisy = || noise([40, 40], 3.0, Boundary::Clamp);
    for alpha in [0.02, 0.05, 0.5, 1.0] {
        run_all([
            Case::new(format!("hills, GGX {alpha}"), hills()).base(ggx(alpha)),
            Case::new(format!("noise, GGX {alpha}"), noisy()).base(ggx(alpha)),
        ]);
    }
    let black_metal = Brdf { diffuse: [0.0; 3], specular: Some(Conductor::ggx(0.3, [0.0; 3])) };
    let gold = Brdf { diffuse: [1.0, 0.0, 0.0], specular: Some(Conductor::ggx(0.2, [1.0, 0.7, 0.0])) };
    run_all([
        Case::new("hills, albedo 0", hills()).base(diffuse(0.0)).within(0.0),
        Case::new("hills, albedo 1", hills()).base(diffuse(1.0)).within(0.05),
        Case::new("hills, one black channel", hills()).base(gold),
        Case::new("hills, f0 = 0", hills()).base(black_metal),
        Case::new("hills, roughness 1, measured", hills()).base(ggx(1.0)).within(0.06),
        Case::new("hills, roughness 0.02, measured", hills()).base(ggx(0.02)).within(1.0),
    ]);
}

#[test]
fn settings_beyond_the_map_survive() {
    let hills = || map([40, 24], waves([40, 24], 8.0, 1.5, 6));
    let odd = [
        ("more patches than cells", 8.0, 16, 7, 1, None),
        ("factor larger than the map", 1000.0, 4, 7, 1, None),
        ("factor 1", 1.0, 4, 7, 1, Some(2)),
        ("one patch, rank 3", 8.0, 1, 7, 3, None),
        ("rank 2", 4.0, 4, 7, 2, None),
        ("rank 3", 4.0, 4, 7, 3, None),
        ("one direction", 8.0, 2, 1, 1, None),
        ("two directions an axis", 8.0, 2, 2, 1, None),
        ("N = 21", 8.0, 2, 21, 1, None),
        ("one lobe", 8.0, 2, 7, 1, Some(1)),
        ("eight lobes", 8.0, 2, 7, 1, Some(8)),
    ];
    for (name, factor, patches, directions, rank, lobes) in odd {
        let case = Case::new(name, hills());
        run(&case.with(|s| {
            let [patches, directions, rank] = [patches, directions, rank].map(Some);
            *s = LevelSettings { factor, patches, directions, rank, lobes, ..*s }
        }));
    }
}

#[test]
fn sizes_are_chosen_on_every_shape_of_map() {
    let hills = || map([40, 24], waves([40, 24], 8.0, 1.5, 6));
    let auto = |s: &mut LevelSettings| {
        // a target that nothing reaches: every way of refining is gone
        *s = LevelSettings { patches: None, directions: None, rank: None, error: 1e-4, ..*s };
    };
    let spike = |i: usize, j: usize| if [i, j] == [3, 3] { 5.0 } else { 0.0 };
    for (name, heights) in [
        ("flat", map([32, 32], |_, _| 1.0)),
        ("one texel", map([1, 1], |_, _| 1.0)),
        ("a line", noise([1, 70], 2.0, Boundary::Clamp)),
        ("cells that are no power of two", noise([88, 56], 3.0, Boundary::Repeat)),
        ("a spike", map([40, 40], spike)),
        ("hills", hills()),
    ] {
        for brdf in [diffuse(0.5), ggx(0.02)] {
            run(&Case::new(format!("{name}, automatic"), heights.clone()).base(brdf).with(auto));
        }
    }
    // each size alone
    for open in 0..3 {
        let case = Case::new(format!("hills, choice {open}"), hills());
        run(&case.with(|s| match open {
            0 => s.patches = None,
            1 => s.directions = None,
            _ => s.rank = None,
        }));
    }
}

#[test]
fn ranks_on_rugged_maps_never_read_below_zero() {
    for (name, heights) in [
        ("noise", noise([48, 48], 6.0, Boundary::Repeat)),
        (
            "one rough quarter",
            map(
                [48, 48],
                |i, j| {
                    if i < 24 && j < 24 { noise([48, 48], 6.0, Boundary::Repeat).vertex(i, j) } else { 0.0 }
                },
            ),
        ),
        ("a tower", map([48, 48], |i, j| if i.abs_diff(20) < 4 && j.abs_diff(30) < 4 { 40.0 } else { 0.0 })),
    ] {
        for rank in [1, 2, 3] {
            for brdf in [diffuse(0.8), ggx(0.2)] {
                let case = Case::new(format!("{name}, rank {rank}"), heights.clone()).base(brdf);
                run(&case.with(|s| (s.rank, s.patches) = (Some(rank), Some(4))));
            }
        }
    }
}
