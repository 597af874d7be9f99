//! What is in a cache, what is removed from it, and in which order.

use std::fs::File;
use std::time::{Duration, SystemTime};

use crate::project::Project;
use crate::workshop::{Surface, build, built, ran};

fn stats(project: &Project) -> serde_json::Value {
    serde_json::from_str(&project.run(&["cache", "stats", "--json"]).stdout).unwrap()
}

#[test]
fn stats_count_what_is_there_and_gc_removes_what_nobody_names() {
    let project = built();
    let before = stats(&project);
    // heights, colors, the asset, and of two levels 9 actions each but one `fine`
    assert_eq!((&before["records"], &before["orphans"]), (&20.into(), &0.into()));
    std::fs::create_dir_all(project.path().join(".farfield/artifacts/00")).unwrap();
    project.write(&format!(".farfield/artifacts/00/{}", "0".repeat(64)), b"of a killed build");
    std::fs::create_dir_all(project.path().join(".farfield/tmp/1-0.tmp")).unwrap();
    project.write(".farfield/tmp/1-0.tmp/7", b"half");
    assert_eq!(stats(&project)["orphans"], 2);
    assert_eq!(project.run(&["cache", "gc"]).code, 0);
    assert_eq!(stats(&project), before);
    assert_eq!(ran(&build(&project, &[])), Vec::<String>::new());
}

#[test]
fn what_was_used_longest_ago_is_evicted_first_and_can_be_made_again() {
    let project = built();
    // Half of the artifacts were last used a day ago, the largest among them.
    let all = project.tree(".farfield/artifacts");
    let mut by_size: Vec<&(String, Vec<u8>)> = all.iter().collect();
    by_size.sort_by_key(|(_, bytes)| std::cmp::Reverse(bytes.len()));
    let (old, recent) = by_size.split_at(by_size.len() / 2);
    for (name, _) in old {
        let file = File::open(project.path().join(".farfield/artifacts").join(name)).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(86_400)).unwrap();
    }
    let total: usize = all.iter().map(|(_, bytes)| bytes.len()).sum();
    let limit = (total * 2 / 3).to_string();
    let said = project.run(&["cache", "gc", "--limit", &limit, "--json"]);
    let removed: serde_json::Value = serde_json::from_str(&said.stdout).unwrap();
    let left = project.tree(".farfield/artifacts");
    let bytes: usize = left.iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(bytes * 10 <= total * 2 / 3 * 10, "{bytes} of {total}");
    assert!(removed["evicted"].as_u64().unwrap() > 0);
    assert!(recent.iter().all(|entry| left.contains(entry)), "what was used today stays");
    let before = project.tree("lod/waves");
    assert_eq!(ran(&build(&project, &[])), Vec::<String>::new(), "what is published needs no artifact");
    assert_eq!(build(&project, &["--out", "other"]).code, 0);
    assert_eq!(project.tree("other/waves"), before);
}

#[test]
fn a_build_keeps_its_cache_within_the_limit() {
    let project = built();
    project.write("farfield.toml", Surface { rank: 2, ..Surface::PLAIN }.manifest().as_bytes());
    build(&project, &["--cache-limit", "60K"]);
    let stats = stats(&project);
    let bytes = stats["record_bytes"].as_u64().unwrap() + stats["artifact_bytes"].as_u64().unwrap();
    assert!(bytes <= 60 << 10, "{bytes}");
}

#[test]
fn everything_can_be_run_again_and_compared() {
    let project = built();
    let lod = project.tree("lod");
    let said = project.run(&["cache", "verify", "--rerun"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""), "{said:?}");
    assert!(said.stdout.ends_with("20 actions ran, 0 gave other bytes than before\n"), "{said:?}");
    // A record that names other bytes, which are there: as if the action had given them before.
    let records = project.tree(".farfield/records");
    let is_of_error = |bytes: &[u8]| String::from_utf8_lossy(bytes).contains("\"stage\":\"measure\"");
    let [first, second] = [0, 1].map(|k| records.iter().filter(|(_, bytes)| is_of_error(bytes)).nth(k).unwrap());
    let json: Vec<serde_json::Value> =
        [first, second].iter().map(|(_, bytes)| serde_json::from_slice(&bytes[65..]).unwrap()).collect();
    let mut forged = json[0].clone();
    forged["outputs"] = json[1]["outputs"].clone();
    let forged = forged.to_string();
    let digest = farfield::build::key::Digest::of(forged.as_bytes());
    project.write(&format!(".farfield/records/{}", first.0), format!("{digest}\n{forged}").as_bytes());
    let said = project.run(&["cache", "verify", "--rerun"]);
    assert_eq!(said.code, 1, "{said:?}");
    assert!(said.stderr.contains("gave other bytes than before for the same inputs"), "{said:?}");
    assert_eq!(project.tree("lod"), lod);
}

#[test]
fn a_folder_that_is_no_cache_is_explained() {
    let project = Project::empty();
    let said = project.run(&["cache", "stats"]);
    assert_eq!(said.code, 1);
    assert_eq!(said.stderr, "error: `.farfield`: is no folder; wanted a build cache, which `farfield build` makes\n");
}
