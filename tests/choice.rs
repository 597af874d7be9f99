//! The automatic choice of M, N and rank: what it picks, what it says of the rest, and that its predictions hold.

mod support;

use farfield::geometry::Boundary;
use farfield::prefilter::surface::{CoarseLevel, FineSurface, LevelSettings, TableSizes};
use support::{at, compiled, crop, diffuse, fixture, ggx, measured, through_bytes};

/// Everything left open, with a target.
fn automatic(error: f64) -> LevelSettings {
    LevelSettings { patches: None, directions: None, rank: None, error, ..at(8.0) }
}

/// A piece of twill, 256².
fn twill(brdf: farfield::material::Brdf) -> FineSurface {
    let heights = crop(&fixture("heights/twill", 24.415), [256, 256], [1.0; 2], Boundary::Repeat);
    FineSurface { heights, brdf, color: None }
}

fn sizes(level: &CoarseLevel) -> TableSizes {
    TableSizes { patches: level.patches, directions: level.directions, rank: level.spatial.len() }
}

/// Predicted error of certain sizes.
fn predicted(level: &CoarseLevel, sizes: TableSizes) -> f64 {
    let found = level.alternatives.iter().find(|alternative| alternative.sizes == sizes);
    found.unwrap_or_else(|| panic!("{sizes:?} is not among {:?}", level.alternatives)).error
}

#[test]
fn a_target_that_the_smallest_tables_meet_gets_them() {
    let level = compiled(&twill(diffuse(0.5)), &automatic(0.5));
    assert_eq!(sizes(&level), TableSizes { patches: [1, 1], directions: 7, rank: 1 });
    assert_eq!(level.predicted, Some(predicted(&level, sizes(&level))));
}

#[test]
fn a_smaller_target_never_gets_a_larger_predicted_error() {
    let surface = twill(ggx(0.3));
    let levels = [0.2, 0.05, 0.03, 0.02, 0.001].map(|error| (error, compiled(&surface, &automatic(error))));
    for (error, level) in &levels {
        println!("{error}: {:?}, predicted {:?}", sizes(level), level.predicted);
    }
    for pair in levels.windows(2) {
        assert!(pair[1].1.predicted <= pair[0].1.predicted);
    }
    assert!(sizes(&levels[4].1) != sizes(&levels[0].1), "nothing was refined");
}

#[test]
fn where_the_target_is_missed_no_alternative_lowers_the_error_by_a_tenth() {
    let level = compiled(&twill(ggx(0.3)), &automatic(1e-4));
    let (own, chosen) = (level.predicted.unwrap(), sizes(&level));
    assert!(own > 1e-4);
    for alternative in &level.alternatives {
        let TableSizes { patches, directions, rank } = alternative.sizes;
        // one step on: the next N, the next rank, any larger M
        let is_next = directions >= chosen.directions && rank <= chosen.rank + 1 && patches >= chosen.patches;
        let skips_one = directions > chosen.directions
            && level
                .alternatives
                .iter()
                .any(|other| (chosen.directions + 1..directions).contains(&other.sizes.directions));
        if is_next && !skips_one {
            assert!(alternative.error > 0.9 * own, "{alternative:?} was left aside at {own}");
        }
    }
}

#[test]
fn what_is_fixed_stays_and_nothing_is_said_where_all_is_fixed() {
    let surface = twill(diffuse(0.5));
    let level = compiled(&surface, &LevelSettings { directions: Some(9), ..automatic(1e-4) });
    assert_eq!(level.directions, 9);
    let level = compiled(&surface, &LevelSettings { patches: Some(3), ..automatic(1e-4) });
    assert_eq!(level.patches, [3, 3]);
    let level = compiled(&surface, &LevelSettings { directions: Some(7), ..at(8.0) });
    assert_eq!((level.predicted, level.alternatives.len()), (None, 0));
}

#[test]
fn the_prediction_agrees_with_exact_ray_casts() {
    // Measured over the same patches, where M is the finest. A third, for the prediction knows 300 pairs of directions and
    // takes them for the other N; and three standard errors of the measurement.
    for (brdf, directions) in [(diffuse(0.5), 7), (ggx(0.3), 7), (ggx(0.3), 11)] {
        let surface = twill(brdf);
        let settings = LevelSettings { patches: Some(16), directions: Some(directions), ..automatic(1.0) };
        let level = compiled(&surface, &settings);
        let error = measured(&surface, &through_bytes(&surface, level.clone()), 1).below_75;
        let predicted = level.predicted.unwrap();
        println!(
            "N = {directions}: predicted {predicted:.4}, measured {:.4} ± {:.4}",
            error.value, error.standard_error
        );
        assert!((predicted - error.value).abs() < error.value / 3.0 + 3.0 * error.standard_error);
    }
}
