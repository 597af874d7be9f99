//! Same input, same bytes: on any number of threads, in every run, whatever the instruction set.

mod support;

use std::collections::BTreeMap;

use farfield::build::encode::surface_level;
use farfield::geometry::Boundary;
use farfield::math::rng::Stream;
use farfield::math::simd::{self, Kernel};
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport};
use formats::cell_brdf::{LobeKernel, exp_neg, half_vector};
use support::{asset, at, both, compiled, crop, diffuse, fixture, measured, through_bytes};

/// A coloured piece of twill under both parts of the base BRDF, and a plain one that repeats.
fn surfaces() -> Vec<(FineSurface, LevelSettings)> {
    let twill = fixture("heights/twill", 24.415);
    let rng = Stream::new(6, 0);
    let color = (0..100 * 70).map(|t| [0, 1, 2].map(|c| rng.uniform(3 * t + c))).collect();
    let colored = FineSurface {
        heights: crop(&twill, [100, 70], [1.0, 1.3], Boundary::Clamp),
        brdf: both(0.2),
        color: Some(color),
    };
    let plain =
        FineSurface { heights: crop(&twill, [96, 96], [1.0; 2], Boundary::Repeat), brdf: diffuse(0.6), color: None };
    vec![
        (
            colored,
            LevelSettings {
                factor: 3.7,
                patches: 3,
                directions: 9,
                rank: 2,
                lobes: None,
                light: LightTransport::Baked,
                error: 0.02,
                seed: 1,
            },
        ),
        (plain, at(8.0)),
    ]
}

/// The files of a compiled level, with its measured error where that is asked for.
fn files(fine: &FineSurface, settings: &LevelSettings, with_error: bool) -> BTreeMap<String, Vec<u8>> {
    let coarse = compiled(fine, settings);
    let error = with_error.then(|| measured(fine, &through_bytes(fine, coarse.clone()), settings.seed));
    let mut level = surface_level(1, &fine.heights, coarse);
    level.error = error;
    asset(fine, vec![level]).encode().unwrap()
}

#[test]
fn thread_counts_and_runs_change_no_byte() {
    for (k, (fine, settings)) in surfaces().into_iter().enumerate() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            // measuring takes longer than compiling: once is enough
            pool.install(|| files(&fine, &settings, k == 0))
        };
        let first = on(1);
        assert!(first.len() > 4, "an asset has several files");
        for threads in [2, 4, 4] {
            let other = on(threads);
            assert_eq!(first.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>(), "{threads} threads");
            for (name, bytes) in &first {
                assert!(bytes == &other[name], "`{name}` differs on {threads} threads");
            }
        }
    }
}

/// What tables of the coarse surface are made of: every value of f_c's closed form for a list of lobes and directions.
#[derive(Clone)]
struct CellValues<'a> {
    lobes: &'a [LobeKernel],
    directions: &'a [[f32; 3]],
}

impl Kernel for CellValues<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run(self) -> Vec<u32> {
        let n = self.directions.len();
        let mut values = vec![0.0; self.lobes.len() * n * n * 3];
        for (lobe, out) in self.lobes.iter().zip(values.chunks_mut(3 * n * n)) {
            let facing: Vec<_> = self.directions.iter().map(|&w| lobe.facing(w)).collect();
            let (cosines, rest) = out.split_at_mut(n * n);
            let (specular, means) = rest.split_at_mut(n * n);
            for (i, &wi) in self.directions.iter().enumerate() {
                for (o, &wo) in self.directions.iter().enumerate() {
                    let cos_io = wi[0] * wo[0] + wi[1] * wo[1] + wi[2] * wo[2];
                    let at = i * n + o;
                    cosines[at] = lobe.cosines(facing[i], facing[o], cos_io);
                    let (ci, co) = (facing[i].cos_mean, facing[o].cos_mean);
                    specular[at] = lobe.specular_term(0.3, [44.0, 3.5], half_vector(wi, wo).1, ci, co);
                    means[at] = facing[i].mean + exp_neg(-20.0 * cos_io.abs());
                }
            }
        }
        values.into_iter().map(f32::to_bits).collect()
    }
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    let rng = Stream::new(12, 0);
    let directions: Vec<[f32; 3]> = (0..150).map(|k| support::random_direction(rng, k).to_array()).collect();
    let kappas = [0.0, 0.3, 2.0, 17.0, 300.0, 1e4, 1e6];
    let lobes: Vec<LobeKernel> = (0..35)
        .map(|k| LobeKernel::new(support::random_direction(rng, 1000 + k).to_array(), kappas[k as usize % 7]))
        .collect();
    let values = CellValues { lobes: &lobes, directions: &directions };
    let [plain, dispatched] = [values.clone().run(), simd::run(values)];
    let different = plain.iter().zip(&dispatched).filter(|(a, b)| a != b).count();
    assert_eq!(different, 0, "of {} values", plain.len());
}
