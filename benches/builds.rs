//! What builds cost beside computing: `cargo bench --bench builds`, or with `noop` or `memory` for one of the two.
//!
//! The binary is run on projects in a temporary folder: 1000 surfaces that are current, and four maps of 4096² within
//! several budgets of memory.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use farfield::io::heights::encode_png16;
use farfield::math::rng::Stream;

fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|argument| argument == name);
    if is_wanted("noop") {
        nothing_to_do();
    }
    if is_wanted("memory") {
        memory();
    }
}

/// Random waves, sixteen bits, which tile.
fn waves(size: u32) -> Vec<u8> {
    let stream = Stream::new(u64::from(size), 5);
    let tile = 512.min(size);
    let line = |k: u64| -> Vec<f64> {
        let cycles = f64::from((stream.uniform(2 * k) * 30.0) as u32 + 1);
        let phase = f64::from(stream.uniform(2 * k + 1));
        (0..tile).map(|i| (std::f64::consts::TAU * (cycles * f64::from(i) / f64::from(tile) + phase)).sin()).collect()
    };
    let lines: Vec<[Vec<f64>; 2]> = (0..8).map(|k| [line(2 * k), line(2 * k + 1)]).collect();
    let height = |u: usize, v: usize| lines.iter().map(|[a, b]| a[u] * b[v]).sum::<f64>() / 16.0 + 0.5;
    let codes: Vec<u16> = (0..(tile * tile) as usize)
        .map(|i| (height(i % tile as usize, i / tile as usize).clamp(0.0, 1.0) * 65535.0) as u16)
        .collect();
    let at = |i: u32| codes[((i / size % tile) * tile + i % size % tile) as usize];
    encode_png16(&(0..size * size).map(at).collect::<Vec<_>>(), size, size)
}

fn run(folder: &Path, arguments: &[&str]) -> Duration {
    let start = Instant::now();
    let mut command = Command::new(env!("CARGO_BIN_EXE_farfield"));
    let output = command.args(arguments).current_dir(folder).output().expect("the binary runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    start.elapsed()
}

/// 1000 surfaces of maps of their own, built once, then looked at.
fn nothing_to_do() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut manifest = String::new();
    for i in 0..1000 {
        std::fs::write(folder.path().join(format!("m{i}.png")), waves(16)).expect("room for maps");
        // One map by its heights, 1000 by their bytes: the header of a PNG may hold a text.
        manifest += &format!(
            "[surface.s{i}]\nheight = \"m{i}.png\"\nsize = [1, 1]\namplitude = 0.02\nlevels = [4, 8]\npatches = 1\n\
             directions = 5\nbsdf = {{ type = \"diffuse\", albedo = [0.5, 0.5, 0.5] }}\n"
        );
    }
    std::fs::write(folder.path().join("farfield.toml"), manifest).expect("room for a manifest");
    println!("1000 surfaces of two levels\n");
    println!("first build {:.1} s", run(folder.path(), &["build", "-q"]).as_secs_f64());
    println!("next build, outputs hashed {:.3} s", run(folder.path(), &["build", "-q"]).as_secs_f64());
    std::thread::sleep(Duration::from_secs(3));
    run(folder.path(), &["build", "-q"]);
    let best = (0..5).map(|_| run(folder.path(), &["build", "-q"])).min().expect("five runs");
    println!("nothing changed, best of 5 {:.3} s\n", best.as_secs_f64());
}

/// Four surfaces of 4096² within several budgets; each in a process of its own, with a cache of its own.
fn memory() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("map.png"), waves(4096)).expect("room for a map");
    // Amplitudes differ, so that nothing is shared.
    let surface = |i: usize| {
        format!(
            "[surface.s{i}]\nheight = \"map.png\"\nsize = [1, 1]\namplitude = 0.00{}\nlevels = [32]\ndirections = 9\n\
             bsdf = {{ type = \"diffuse\", albedo = [0.5, 0.5, 0.5] }}\n",
            i + 1
        )
    };
    std::fs::write(folder.path().join("farfield.toml"), (0..4).map(surface).collect::<String>()).expect("room");
    println!("four surfaces of 4096², N = 9, two threads\n\n| --memory | peak MiB | seconds |\n|---|---|---|");
    for budget in ["1G", "1500M", "4G"] {
        let cache = format!("cache{budget}");
        let arguments = ["build", "-q", "--jobs", "2", "--memory", budget, "--out", "lod", "--cache", &cache, "--json"];
        let time = run(folder.path(), &arguments);
        let records = farfield::build::record::read(&folder.path().join("lod"));
        let peak = records.iter().map(|record| record.peak_bytes).max().unwrap_or(0);
        println!("| {budget} | {} | {:.1} |", peak >> 20, time.as_secs_f64());
        std::fs::remove_dir_all(folder.path().join("lod")).expect("it was made");
    }
}
