//! A verification on the terminal: a row a model, light and view.

use serde_json::json;

use super::metrics::Interval;
use super::table::aligned;
use super::verification::{LevelVerification, Verification};

/// Every model of every case; below each level what equal time gives.
pub fn verification_table(verification: &Verification) -> String {
    let mut text = String::new();
    for asset in &verification.assets {
        for level in &asset.levels {
            let header = ["name", "level", "light", "view", "model", "mean error", "rel. MSE (bias)", "noise", "FLIP"];
            let mut rows = vec![header.map(String::from).to_vec()];
            for case in &level.cases {
                rows.extend(case.models.iter().map(|model| {
                    vec![
                        asset.name.clone(),
                        level.index.to_string(),
                        case.light.name().into(),
                        case.view.name().into(),
                        model.model.name().into(),
                        model.mean_error.map_or("–".into(), percent),
                        model.relative_mse.map_or("–".into(), |mse| format!("{:.2e}", mse.bias.value)),
                        model.relative_mse.map_or("–".into(), |mse| format!("{:.2e}", mse.noise)),
                        format!("{:.4}", model.flip),
                    ]
                }));
            }
            text += &aligned(&rows);
            if let Some(ratio) = level.timing.equal_time_ratio {
                text += &format!("equal time: MSE of the level over that of the original {ratio:.3}\n");
            }
        }
    }
    text
}

/// A finished level as one line of JSON.
pub fn level_json(name: &str, level: &LevelVerification) -> String {
    format!("{}\n", json!({ "name": name, "level": level }))
}

/// `+0.12 ± 0.05 %`, one half of the 95 % interval.
fn percent(error: Interval) -> String {
    format!("{:+.2} ± {:.2} %", error.value * 100.0, (error.high - error.low) * 50.0)
}
