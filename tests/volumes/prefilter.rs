//! Coarse levels: derivatives, energy, optimisers, means.

use farfield::math::rng::Stream;
use farfield::medium::{Medium, MediumShape, Voxel};
use farfield::prefilter::volume::baselines::naive;
use farfield::prefilter::volume::views::{training_lights, training_views};
use farfield::prefilter::volume::{
    Clusters, Density, Optimizer, Problem, Prototypes, Recording, VolumeSettings, Weights, compile, view_means,
};
use farfield::transport::volume::means::{Masks, VIEW_CELLS, Walks};
use formats::sggx::{FlakeLobe, Sggx};

use crate::scenes::VOXEL;

/// A cloth of two crossing layers of yarns with gaps between them: red along x, blue along y.
fn cloth(size: [usize; 3], shift: usize) -> Medium {
    let shape = MediumShape { size, voxel: [VOXEL; 3], repeat: [true, true, false] };
    Medium::new(shape, 1, |[x, y, z]| {
        let is_upper = z >= size[2] / 2;
        let across = if is_upper { y } else { x } + shift;
        let axis = if is_upper { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let albedo = if is_upper { [0.95, 0.4, 0.3] } else { [0.3, 0.5, 0.95] };
        let lobe = FlakeLobe { area: 1.0, shape: Sggx::fibre(axis, 0.2), albedo };
        (across % 4 < 2).then(|| Voxel::new(1.5 / VOXEL as f32, &[lobe]))
    })
}

/// The level of plain averages with its clusters.
fn average(fine: &Medium, factor: f64, lobes: Option<usize>) -> (Medium, Clusters) {
    let prototypes = Prototypes::new(fine, factor, lobes, 1);
    let level = naive::level(fine, factor, &prototypes);
    let clusters = Clusters::new(&level, Some(2), 1);
    (level, clusters)
}

#[test]
fn derivatives_are_the_differences_of_independent_renders() {
    let fine = cloth([16, 16, 12], 0);
    let (level, clusters) = average(&fine, 4.0, Some(2));
    assert_eq!((level.lobe_count(), clusters.count), (2, 2));
    let all = Masks { clusters: vec![1; VIEW_CELLS] };
    let views: Vec<_> = training_views(&[true, true, false]).into_iter().take(2).map(|v| (v, all.clone())).collect();
    let lights = training_lights();
    let mut weights = Weights::ones(clusters.count, level.lobe_count());
    weights.factors.iter_mut().for_each(|w| *w = [0.8, 0.9, 1.0]);
    let walks = |seed| Walks { count: 100_000, seed };
    let recording = Recording::new(&level, &clusters, &weights, &views, walks(1));
    let evaluation = recording.evaluate(&weights, &weights, &lights);
    let rows = (clusters.count + 1) * lights.len() * 3;
    let start = weights.logarithms();
    let step = 0.05;
    for unknown in 0..weights.unknowns() {
        let rendered = |sign: f64, seed: u64| {
            let mut moved = start.clone();
            moved[unknown] += sign * step;
            let medium = weights.from_logarithms(&moved).apply(&level, &clusters);
            view_means(&medium, &views, clusters.count, &lights, walks(seed))
        };
        let [ahead, behind] = [rendered(1.0, 100), rendered(-1.0, 200)];
        for (v, (ahead, behind)) in ahead.iter().zip(&behind).enumerate() {
            for (l, c) in (0..lights.len()).flat_map(|l| (0..3).map(move |c| (l, c))) {
                let k = clusters.count;
                let difference = (ahead.means[k][l][c] - behind.means[k][l][c]) / (2.0 * step);
                let error = (ahead.variances[k][l][c] + behind.variances[k][l][c]).sqrt() / (2.0 * step);
                let derivative = evaluation.derivatives[v * rows + (k * lights.len() + l) * 3 + c][unknown];
                // noise of both renders, of the derivative itself, and step²/6 of the third derivative: of n reflections
                // n² times the first, n up to 8
                let allowed = 4.5 * error * 1.2 + 0.03 * derivative.abs() + 1e-5;
                assert!((difference - derivative).abs() < allowed, "{unknown} {v} {l} {c}: {difference} {derivative}");
            }
        }
    }
}

#[test]
fn reweighted_walks_give_the_means_of_a_render_with_those_weights() {
    let fine = cloth([16, 16, 12], 0);
    let (level, clusters) = average(&fine, 4.0, None);
    let all = Masks { clusters: vec![1; VIEW_CELLS] };
    let views: Vec<_> = training_views(&[true, true, false]).into_iter().take(2).map(|v| (v, all.clone())).collect();
    let lights = training_lights();
    let ones = Weights::ones(clusters.count, level.lobe_count());
    let mut weights = ones.clone();
    weights.factors[0] = [0.5, 0.7, 1.0];
    weights.colours[1] = [1.5, 0.6, 0.9]; // beyond an albedo of 1, too
    let walks = |seed| Walks { count: 100_000, seed };
    let recording = Recording::new(&level, &clusters, &ones, &views, walks(1));
    let evaluation = recording.evaluate(&weights, &ones, &lights);
    let rendered = view_means(&weights.apply(&level, &clusters), &views, clusters.count, &lights, walks(2));
    let rows = (clusters.count + 1) * lights.len() * 3;
    let k = clusters.count;
    for (v, view) in rendered.iter().enumerate() {
        for (l, c) in (0..lights.len()).flat_map(|l| (0..3).map(move |c| (l, c))) {
            let reweighted = evaluation.means[v * rows + (k * lights.len() + l) * 3 + c];
            let error = view.variances[k][l][c].sqrt() * 1.5;
            assert!((reweighted - view.means[k][l][c]).abs() < 4.5 * error, "{v} {l} {c}: {reweighted} {view:?}");
        }
    }
}

#[test]
fn a_fit_halves_the_objective_pleases_unseen_views_and_makes_no_light() {
    let fine = cloth([24, 24, 16], 0);
    for optimizer in [Optimizer::LevenbergMarquardt, Optimizer::StochasticGradient] {
        let settings = VolumeSettings { optimizer, walks: 2048, ..VolumeSettings::default() };
        let level = compile(&fine, &settings);
        let [before, after] = level.diagnostics.validation;
        let [naive, fitted] = level.diagnostics.objective;
        assert!(level.diagnostics.is_accepted && after < before, "{optimizer:?}: {:?}", level.diagnostics);
        assert!(fitted < 0.5 * naive, "{optimizer:?}: {:?}", level.diagnostics);
        for index in 0..level.medium.occupied() {
            let voxel = level.medium.voxel(index);
            let area: f32 = voxel.lobes().iter().map(|lobe| lobe.area).sum();
            assert!((area - 1.0).abs() < 1e-4);
            assert!(voxel.lobes().iter().flat_map(|lobe| lobe.albedo).all(|a| (0.0..=1.0).contains(&a)));
        }
    }
}

#[test]
fn both_optimisers_reach_the_same_minimum() {
    let fine = cloth([24, 24, 16], 0);
    let (level, clusters) = average(&fine, 4.0, None);
    let problem = Problem::new(&fine, &level, clusters, 8192, 1);
    let ones = Weights::ones(problem.clusters().count, level.lobe_count());
    let objective = |weights: &Weights| problem.objective(&level, weights, Walks { count: 16_384, seed: 1 << 40 });
    let [naive, lm, sgd] =
        [objective(&ones), objective(&problem.minimise(&level, &ones).0), objective(&problem.descend(&level, &ones).0)];
    assert!((sgd - lm).abs() < 0.01 * (naive - lm), "{naive} {lm} {sgd}");
}

#[test]
fn a_level_is_the_same_on_any_number_of_threads() {
    let fine = cloth([16, 16, 12], 0);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| compile(&fine, &VolumeSettings { walks: 512, ..VolumeSettings::default() }))
    };
    let [one, three] = [on(1), on(3)];
    assert_eq!((&one.weights, &one.diagnostics), (&three.weights, &three.diagnostics));
    for index in 0..one.medium.occupied() {
        assert_eq!(one.medium.voxel(index), three.medium.voxel(index));
    }
}

/// Mean radiance of all views, lights and channels.
fn brightness(medium: &Medium) -> f64 {
    let all = Masks { clusters: vec![1; VIEW_CELLS] };
    let views: Vec<_> = training_views(&medium.shape().repeat).into_iter().map(|v| (v, all.clone())).collect();
    let means = view_means(medium, &views, 1, &training_lights(), Walks { count: 40_000, seed: 3 });
    means.iter().flat_map(|view| view.means[1].iter().flatten().copied()).sum()
}

#[test]
fn two_shifts_of_one_cloth_have_levels_of_the_same_brightness() {
    let levels = [0, 1].map(|shift| {
        let settings = VolumeSettings { factor: 3.0, walks: 16_384, ..VolumeSettings::default() };
        brightness(&compile(&cloth([24, 24, 18], shift), &settings).medium)
    });
    assert!((levels[0] / levels[1] - 1.0).abs() < 0.01, "{levels:?}");
}

#[test]
fn hard_volumes_give_levels_without_panic_or_nan() {
    let lobe = |along: f32, albedo: f32| FlakeLobe {
        area: 1.0,
        shape: Sggx::fibre([0.6, 0.0, 0.8], along),
        albedo: [albedo, 0.0, 1.0],
    };
    let made = |size: [usize; 3], density: f32, along: f32, albedo: f32, share: f32| {
        let shape = MediumShape { size, voxel: [VOXEL, 3.0 * VOXEL, VOXEL], repeat: [false; 3] };
        Medium::new(shape, 1, move |[x, y, z]| {
            let chance = Stream::new(1, (x + 100 * y + 10_000 * z) as u64).uniform(0);
            (chance < share && density > 0.0).then(|| Voxel::new(density, &[lobe(along, albedo)]))
        })
    };
    let cases = [
        made([4, 4, 4], 0.0, 0.1, 0.5, 1.0),   // empty
        made([1, 1, 1], 1e5, 0.1, 0.5, 1.0),   // one voxel
        made([1, 7, 3], 1e5, 1.0, 0.0, 1.0),   // full and black
        made([5, 5, 5], 1e6, 0.001, 1.0, 1.0), // dense, flat and white
        made([6, 5, 4], 1e-3, 0.01, 0.9, 0.2), // hardly there
    ];
    for (case, fine) in cases.iter().enumerate() {
        for (lobes, clusters) in [(None, None), (Some(3), Some(8))] {
            for density in [Density::Auto, Density::Average] {
                let settings =
                    VolumeSettings { lobes, clusters, density, walks: 128, factor: 2.0, ..VolumeSettings::default() };
                let level = compile(fine, &settings);
                let values = level.diagnostics.objective.into_iter().chain(level.diagnostics.validation);
                assert!(values.into_iter().all(f64::is_finite), "case {case}: {:?}", level.diagnostics);
                assert!(level.weights.logarithms().iter().all(|w| w.is_finite()), "case {case}");
                assert_eq!(level.medium.occupied() == 0, fine.occupied() == 0, "case {case}");
                for index in 0..level.medium.occupied() {
                    let voxel = level.medium.voxel(index);
                    let finite = |lobe: &FlakeLobe| lobe.shape.matrix().iter().all(|s| s.is_finite());
                    assert!(voxel.density.is_finite() && voxel.lobes().iter().all(finite), "case {case}: {voxel:?}");
                }
            }
        }
    }
}

#[test]
fn a_colour_gradient_has_no_step_where_clusters_meet() {
    // A block whose albedo rises along x: neighbouring layers must get nearly the same factor. A layer has a hundred voxels,
    // so that dealing them to two clusters is even to a few thousandths of the factor.
    let shape = MediumShape { size: [256, 24, 24], voxel: [VOXEL; 3], repeat: [false; 3] };
    let fine = Medium::new(shape, 1, |[x, y, z]| {
        let rise = (x as f32 + 0.5) / 256.0;
        let albedo = [0.2 + 0.7 * rise, 0.5, 0.9 - 0.7 * rise];
        let lobe = FlakeLobe { area: 1.0, shape: Sggx::fibre([0.0, 1.0, 0.0], 0.3), albedo };
        ((y / 2 + z / 2) % 3 == 0).then(|| Voxel::new(1.5 / VOXEL as f32, &[lobe]))
    });
    let plain = VolumeSettings { factor: 2.0, optimizer: Optimizer::None, ..VolumeSettings::default() };
    let fitted = VolumeSettings { optimizer: Optimizer::LevenbergMarquardt, density: Density::Average, ..plain };
    let [plain, fitted] = [plain, fitted].map(|settings| compile(&fine, &settings));
    assert!(fitted.diagnostics.is_accepted && fitted.clusters.count > 1, "{:?}", fitted.diagnostics);
    let [nx, ny, nz] = fitted.medium.shape().size;
    let mean = |medium: &Medium, x: usize| {
        let places = (0..ny * nz).map(|k| [x, k % ny, k / ny]);
        let voxels = places.filter_map(|at| medium.voxel_index(at)).map(|index| medium.voxel(index));
        voxels.map(|voxel| f64::from(voxel.lobes()[0].albedo[1])).sum::<f64>()
    };
    let factors: Vec<f64> = (0..nx).map(|x| mean(&fitted.medium, x) / mean(&plain.medium, x)).collect();
    let step = factors.windows(2).map(|pair| (pair[1] / pair[0] - 1.0).abs()).fold(0.0, f64::max);
    assert!(step < 0.01, "a step of {step}: {factors:.3?}");
}
