//! Volumes: paths a second, what majorants of super-voxels gain, and how well coarse levels are fitted.
//!
//! `cargo bench --bench volume [-- tracking|fit|optimizers|test|published [SCENE…]]`; the last only if asked for, it takes hours. Needs the synthetic scenes (`FARFIELD_VOLUMES`, or beside the
//! project).

#[path = "../../tests/support/vol.rs"]
mod vol;

mod fit;
mod optimizers;
mod published;
mod test;
mod tracking;

use vol::{SCENES, Scene};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let Some(folder) = vol::folder() else { return };
    let part = arguments.first().map_or("all", String::as_str);
    let is_wanted = |scene: &&Scene| arguments.len() < 2 || arguments[1..].iter().any(|name| name == scene.name);
    let scenes: Vec<Scene> = SCENES.iter().filter(is_wanted).copied().collect();
    if ["all", "tracking"].contains(&part) {
        tracking::run(&scenes, &folder);
    }
    if ["all", "fit"].contains(&part) {
        fit::run(&scenes, &folder);
    }
    if ["all", "optimizers"].contains(&part) {
        optimizers::run(&scenes, &folder);
    }
    if part == "published" {
        published::run(&scenes, &folder);
    }
    if ["all", "test"].contains(&part) {
        test::run(&scenes, &folder);
    }
}
