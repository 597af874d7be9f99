//! Same inputs, same bytes.

use crate::project::Project;

#[test]
fn threads_and_runs_change_no_byte() {
    let project = Project::waves();
    let build = |out: &str, jobs: &str| {
        assert_eq!(project.run(&["build", "-q", "--out", out, "--jobs", jobs]).code, 0);
        project.tree(&format!("{out}/waves"))
    };
    let first = build("one", "1");
    assert!(first.len() > 4);
    assert_eq!(first, build("two", "2"));
    assert_eq!(first, build("four", "4"));
    assert_eq!(first, build("one", "1"));
}
