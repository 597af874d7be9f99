//! `tradeoff`: its tables, its files, and what it refuses.

use crate::project::{Project, Said, surface, waves};

/// A project whose surface has one level with everything chosen by the error.
fn automatic() -> Project {
    let project = Project::empty();
    project.write("waves.png", &waves(48, 32));
    let manifest = surface("waves", "waves.png").replace("patches = 2\ndirections = 7\nrank = 1\n", "");
    project.write("farfield.toml", manifest.replace("levels = [4, 8]", "levels = [4]").as_bytes());
    project
}

const SMALL: [&str; 8] = ["--size", "8", "--spp", "8", "--errors", "0.5,0.05,0.02", "--jobs", "2"];

fn swept(project: &Project, more: &[&str]) -> Said {
    project.run(&[&["tradeoff", "waves"], &SMALL[..], more].concat())
}

#[test]
fn a_sweep_prints_a_row_a_target_and_writes_table_and_plot() {
    let project = automatic();
    let said = swept(&project, &[]);
    assert_eq!(said.code, 0, "{said:?}");
    assert_eq!(said.stderr, "waves: level 1, error 0.5\nwaves: level 1, error 0.05\nwaves: level 1, error 0.02\n");
    let lines: Vec<&str> = said.stdout.lines().collect();
    assert!(lines[0].starts_with("name   level  target  M"), "{}", said.stdout);
    assert_eq!(lines.len(), 4);
    assert!(lines[1].starts_with("waves  1      50 %    1"), "{}", said.stdout);
    assert!(lines[3].starts_with("waves  1      2 %"), "{}", said.stdout);

    let files: Vec<String> = project.tree("report").into_iter().map(|(name, _)| name).collect();
    assert_eq!(files, ["tradeoff-waves.json", "tradeoff-waves.svg", "tradeoff-waves.txt"]);
    let read = |name: &str| std::fs::read_to_string(project.path().join("report").join(name)).unwrap();
    assert_eq!(read("tradeoff-waves.txt"), said.stdout);
    let svg = read("tradeoff-waves.svg");
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{svg}");
    for axis in ["CPU seconds to compile", "KB on disk"] {
        assert!(svg.contains(axis), "{axis}");
    }
}

#[test]
fn a_smaller_target_is_a_level_of_no_larger_error() {
    let project = automatic();
    let said = swept(&project, &["--json", "-q"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    let rows: Vec<serde_json::Value> = said.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let targets: Vec<f64> = rows.iter().map(|row| row["row"]["target"].as_f64().unwrap()).collect();
    assert_eq!(targets, [0.5, 0.05, 0.02]);
    let predicted: Vec<f64> = rows.iter().map(|row| row["row"]["predicted"].as_f64().unwrap()).collect();
    assert!(predicted.windows(2).all(|pair| pair[1] <= pair[0]), "{predicted:?}");
    assert_eq!(rows[0]["row"]["N"], 7);
    for row in &rows {
        let row = &row["row"];
        assert!(row["below_75"]["value"].as_f64().unwrap() > 0.0 && row["bytes"].as_u64().unwrap() > 0, "{row}");
        assert!(row["image"]["low"].is_f64() && row["image_mean"]["value"].is_f64(), "{row}");
    }
}

#[test]
fn a_study_takes_the_factorisation_apart() {
    let project = automatic();
    let said = project.run(&["tradeoff", "waves", "--study", "--json", "-q"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    let study: serde_json::Value = serde_json::from_str(&said.stdout).unwrap();
    let shares: Vec<f64> = study["singular_shares"].as_array().unwrap().iter().map(|s| s.as_f64().unwrap()).collect();
    assert!(shares.windows(2).all(|pair| pair[0] >= pair[1]), "{shares:?}");
    assert!(shares.iter().sum::<f64>() <= 1.0 + 1e-9 && shares[0] > 0.5, "{shares:?}");
    let count = |varied: &str| {
        study["sizes"].as_array().unwrap().iter().filter(|row| row["varied"].as_str() == Some(varied)).count()
    };
    assert_eq!(["–", "N", "M", "rank", "lobes"].map(count), [1, 4, 4, 2, 8]);
    let methods = study["methods"].as_array().unwrap();
    let errors = |name: &str| {
        let row = methods.iter().find(|row| row["method"].as_str().unwrap().starts_with(name)).unwrap();
        ["below_75", "above_75"].map(|figure| row[figure].as_f64().unwrap())
    };
    // least squares minimises the sum of both, so that nothing is better in both; zero bias costs it next to nothing
    let least = errors("alternating least squares, rank 1");
    for other in ["ratio of averages", "averages of ratios", "singular value"] {
        let other_errors = errors(other);
        assert!((0..2).any(|k| least[k] <= 1.001 * other_errors[k]), "{other}: {other_errors:?} under {least:?}");
    }
    let files: Vec<String> = project.tree("report").into_iter().map(|(name, _)| name).collect();
    assert_eq!(files, ["study-waves.json", "study-waves.txt"]);
}

#[test]
fn what_makes_no_sense_is_refused_and_leaves_no_trace() {
    let project = automatic();
    let before = project.tree("");
    for (arguments, code, wanted) in [
        (&["tradeoff", "wave"][..], 2, "error: `farfield.toml` has no surface `wave`; did you mean `waves`?\n"),
        (&["tradeoff", "waves", "--level", "2"], 2, "error: `--level` is 2; wanted 1 to 1, the levels of `waves`\n"),
        (
            &["tradeoff", "waves", "--report", "waves.png/report"],
            1,
            "error: `waves.png/report`: cannot be written: not a directory\n",
        ),
    ] {
        let said = project.run(arguments);
        assert_eq!((said.code, said.stdout.as_str(), said.stderr.as_str()), (code, "", wanted));
    }
    for arguments in [
        &["tradeoff"][..],
        &["tradeoff", "waves", "--errors", "0"],
        &["tradeoff", "waves", "--errors", "0.1,x"],
        &["tradeoff", "waves", "--errors", ""],
        &["tradeoff", "waves", "--study", "--errors", "0.1"],
        &["tradeoff", "waves", "--size", "4"],
    ] {
        let said = project.run(arguments);
        assert_eq!((said.code, said.stdout.as_str()), (2, ""), "{arguments:?}");
    }
    std::fs::remove_file(project.path().join("waves.png")).unwrap();
    let said = project.run(&["tradeoff", "waves", "-q"]);
    assert_eq!(said.code, 1);
    assert_eq!(said.stderr, "error: surface `waves`: `waves.png`: cannot be read: no such file or directory\n");
    assert!(before.iter().any(|(name, _)| name == "waves.png") && project.tree("report").is_empty());
}
