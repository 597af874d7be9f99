//! The house stands as `DESIGN.md` draws it: rooms import downward only, name their own outside crates only, the core
//! neither fails nor looks at files, clock or environment, and no module outgrows its reader.
//!
//! What is read is the text of `src/` and `formats/src/`: `use` lines and every other path that starts with `crate::`,
//! `super::` or the name of a dependency. Comments and strings are cut out first.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// What a room may name.
struct Room {
    /// The room's path, as in `prefilter::surface`.
    path: &'static str,
    /// Rooms that it may import, itself apart.
    rooms: &'static [&'static str],
    /// Outside crates that it may name.
    crates: &'static [&'static str],
    /// Whether it may do I/O and fail.
    may_fail: bool,
}

/// The rooms, bottom up. `formats::lookup`, `cell_brdf`, `level_brdf`, `sggx` and `symmetric` are open to all (see [`ONE_FORMULA`]).
const HOUSE: [Room; 14] = [
    Room { path: "math", rooms: &[], crates: &["glam"], may_fail: false },
    Room { path: "geometry", rooms: &["math"], crates: &["glam"], may_fail: false },
    Room { path: "material", rooms: &["math"], crates: &["glam"], may_fail: false },
    Room { path: "medium", rooms: &["math"], crates: &["glam"], may_fail: false },
    Room {
        path: "transport",
        rooms: &["math", "geometry", "material", "medium"],
        crates: &["glam", "rayon", "sobol_burley"],
        may_fail: false,
    },
    Room { path: "prefilter", rooms: &[], crates: &[], may_fail: false },
    Room {
        path: "prefilter::surface",
        rooms: &["math", "geometry", "material", "transport"],
        crates: &["glam", "rayon"],
        may_fail: false,
    },
    // The solver's room within the room: no other file plans an FFT.
    Room {
        path: "prefilter::surface::downsample",
        rooms: &["math", "geometry", "prefilter::surface"],
        crates: &["glam", "rayon", "rustfft"],
        may_fail: false,
    },
    Room {
        path: "prefilter::volume",
        rooms: &["math", "medium", "transport"],
        crates: &["glam", "rayon"],
        may_fail: false,
    },
    Room {
        path: "io",
        rooms: &["math", "geometry", "material"],
        crates: &["formats", "blake3", "exr", "image", "tiff", "thiserror"],
        may_fail: true,
    },
    // `glam`: `build::level_error` casts rays from what it decodes. `nix`: CPU seconds and peak memory of the process.
    Room {
        path: "build",
        rooms: &[
            "math",
            "geometry",
            "material",
            "medium",
            "transport",
            "prefilter",
            "prefilter::surface",
            "prefilter::volume",
            "io",
        ],
        crates: &["formats", "blake3", "glam", "nix", "rayon", "serde", "serde_json", "thiserror", "toml"],
        may_fail: true,
    },
    // The only files that speak to a network, and that listen to the file system.
    Room { path: "build::store::remote", rooms: &[], crates: &["rusty_s3", "thiserror", "ureq"], may_fail: true },
    Room { path: "build::watch", rooms: &[], crates: &["notify"], may_fail: true },
    // `nalgebra`: the singular values of a study.
    Room {
        path: "report",
        rooms: &[
            "math",
            "geometry",
            "material",
            "transport",
            "prefilter",
            "prefilter::surface",
            "prefilter::volume",
            "io",
            "build",
        ],
        crates: &["base64", "formats", "glam", "maud", "nalgebra", "nv_flip", "rayon", "serde", "serde_json"],
        may_fail: true,
    },
];

/// The attic: above the rest, but it calls `build`, `report`, `io` (the publisher that an interruption halts, the reading of
/// an asset's document) and the renderer of `transport`, nothing else of the core.
const CLI: Room = Room {
    path: "cli",
    rooms: &["transport", "io", "build", "report"],
    crates: &["formats", "blake3", "clap", "ctrlc", "indicatif", "rayon", "serde_json"],
    may_fail: true,
};

/// The crate on disk imports no room; `serde` gives its document its keys.
const FORMATS: Room =
    Room { path: "", rooms: &[], crates: &["blake3", "half", "ktx2", "serde", "serde_json", "zstd"], may_fail: true };

/// Modules of `formats` that every room may call: compiler and reader share one table lookup, one f_c and one f_low.
const ONE_FORMULA: [&str; 5] =
    ["formats::lookup", "formats::cell_brdf", "formats::level_brdf", "formats::sggx", "formats::symmetric"];

/// Crates that tests beside the code may name, too.
const TEST_CRATES: [&str; 4] = ["cpu_time", "nalgebra", "rayon", "tempfile"];

/// What the core may not look at.
const OUTSIDE_WORLD: [&str; 7] =
    ["std::env", "std::fs", "std::io", "std::net", "std::process", "std::time", "std::thread"];

/// The longest module, tests included.
const MAX_LINES: usize = 600;

#[test]
fn rooms_import_downward_only() {
    let dependencies = dependencies("Cargo.toml");
    let rooms = || HOUSE.iter().chain([&CLI]);
    let mut faults = Vec::new();
    for source in sources("src").iter().filter(|source| !source.module.is_empty()) {
        let Some(room) = rooms().filter(|room| source.lies_in(room.path)).max_by_key(|room| room.path.len()) else {
            faults.push(format!("{}: lies in no room of the table", source.file.display()));
            continue;
        };
        for path in source.paths(&dependencies) {
            let reached = path.text.strip_prefix("crate::").map(|inner| {
                let inside = |room: &&Room| is_within(inner, room.path);
                rooms().filter(inside).map(|room| room.path).max_by_key(|path| path.len()).unwrap_or(inner)
            });
            let is_allowed = match reached {
                // A room's own inner rooms are the room.
                Some(reached) => is_within(reached, room.path) || room.rooms.contains(&reached),
                None => {
                    let name = path.text.split("::").next().unwrap_or_default();
                    room.crates.contains(&name)
                        || ONE_FORMULA.iter().any(|open| is_within(&path.text, open))
                        || path.is_test && TEST_CRATES.contains(&name)
                }
            };
            if !is_allowed {
                let place = format!("{}:{}", source.file.display(), path.line);
                faults.push(format!("{place}: room `{}` names `{}`", room.path, path.text));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn formats_imports_nothing_of_the_compiler() {
    let dependencies = dependencies("formats/Cargo.toml");
    let allowed: BTreeSet<String> = FORMATS.crates.iter().map(|&name| name.into()).collect();
    let unlisted: Vec<_> =
        dependencies.difference(&allowed).map(|name| format!("formats depends on `{name}`")).collect();
    expect_none(&unlisted);
    let of_the_compiler: BTreeSet<String> = ["farfield", "glam", "rayon"].map(String::from).into();
    let faults = sources("formats/src").into_iter().flat_map(|source| {
        let file = source.file.display().to_string();
        source
            .paths(&of_the_compiler)
            .into_iter()
            .filter(|path| !path.text.starts_with("crate::"))
            .map(move |path| format!("{file}:{}: `formats` names `{}`", path.line, path.text))
    });
    expect_none(&faults.collect::<Vec<_>>());
}

#[test]
fn the_core_cannot_fail_and_sees_nothing_of_the_outside_world() {
    let mut faults = Vec::new();
    let core = HOUSE.iter().filter(|room| !room.may_fail);
    let in_core = |source: &&Source| core.clone().any(|room| source.lies_in(room.path));
    for source in sources("src").iter().filter(in_core) {
        for (number, line) in source.code.lines().take(source.tests_from).enumerate() {
            let place = format!("{}:{}", source.file.display(), number + 1);
            // A checked constructor gives the type itself.
            if line.contains("Result<") && !line.contains("-> Result<Self") {
                faults.push(format!("{place}: a `Result` in the core"));
            }
            let seen = OUTSIDE_WORLD.iter().filter(|path| line.contains(**path));
            faults.extend(seen.map(|path| format!("{place}: `{path}` in the core")));
            if ["print!(", "println!(", "eprint!(", "eprintln!(", "dbg!("].iter().any(|word| line.contains(word)) {
                faults.push(format!("{place}: output in the core"));
            }
        }
    }
    expect_none(&faults);
}

#[test]
fn no_module_is_longer_than_600_lines() {
    let faults = ["src", "formats/src"].into_iter().flat_map(sources).filter_map(|source| {
        let lines = source.code.lines().count();
        (lines > MAX_LINES).then(|| format!("{}: {lines} lines", source.file.display()))
    });
    expect_none(&faults.collect::<Vec<_>>());
}

#[test]
fn paths_are_found_wherever_they_stand() {
    let text = "//! use crate::cli;\nuse crate::math::{rng, simd::{self, run}};\npub(crate) use super::super::io as\n    \
                bytes;\nfn f() { let s = \"crate::no\"; g(formats::lookup::tap, x.glam); crate::build::run::<u8>(); }\n\
                #[cfg(test)]\nmod tests {\n    use super::*;\n    use super::super::report;\n}\n";
    let module = ["prefilter", "surface"].map(String::from).to_vec();
    let source = Source::new(PathBuf::from("src/prefilter/surface/x.rs"), module, text);
    let dependencies = ["formats", "glam"].map(String::from).into();
    let found: Vec<_> = source.paths(&dependencies).into_iter().map(|path| (path.line, path.text)).collect();
    let wanted = [
        (2, "crate::math::rng"),
        (2, "crate::math::simd::self"),
        (2, "crate::math::simd::run"),
        (3, "crate::io"),
        (5, "formats::lookup::tap"),
        (5, "crate::build::run"),
        (8, "crate::prefilter::surface::*"),
        (9, "crate::prefilter::report"),
    ];
    assert_eq!(found, wanted.map(|(line, text)| (line, text.to_string())));
    let tests: Vec<_> = source.paths(&dependencies).into_iter().map(|path| path.is_test).collect();
    assert_eq!(tests, [false, false, false, false, false, false, true, true]);
}

/// One file of source text.
struct Source {
    file: PathBuf,
    /// The module that the file is, empty for the crate's root.
    module: Vec<String>,
    /// The text, comments and contents of strings blanked.
    code: String,
    /// Lines before the tests at the file's end.
    tests_from: usize,
}

/// A path named in a file.
struct Named {
    line: usize,
    text: String,
    is_test: bool,
}

impl Source {
    fn new(file: PathBuf, module: Vec<String>, text: &str) -> Self {
        let code = blanked(text);
        let lines: Vec<&str> = code.lines().collect();
        let tests_only = file.file_name().is_some_and(|name| name == "tests.rs");
        let opens_tests = |i: &usize| lines[*i].trim() == "#[cfg(test)]" && lines[i + 1].contains("mod tests {");
        let first = (0..lines.len().saturating_sub(1)).find(opens_tests).unwrap_or(lines.len());
        let tests_from = if tests_only { 0 } else { first };
        Self { file, module, code, tests_from }
    }

    /// Whether the file is the room `path` or inside of it.
    fn lies_in(&self, path: &str) -> bool {
        is_within(&self.module.join("::"), path)
    }

    /// All paths that start with `crate`, `super` or one of `outside`; `super` resolved.
    fn paths(&self, outside: &BTreeSet<String>) -> Vec<Named> {
        let mut found = Vec::new();
        let code = self.code.as_str();
        let mut at = 0;
        while let Some(start) = next_word(code, at) {
            at = word_end(code, start);
            let word = &code[start..at];
            let is_inside = word == "crate" || word == "super";
            let begins_a_path = code[at..].trim_start().starts_with("::") && !is_continuation(&code[..start]);
            if !begins_a_path || !(is_inside || outside.contains(word)) {
                continue;
            }
            let line = code[..start].matches('\n').count();
            let mut leaves = Vec::new();
            at = leaves_of(code, start, String::new(), &mut leaves);
            let is_test = line >= self.tests_from;
            // The inner module of tests is one `super` further down.
            let is_inner = is_test && self.tests_from > 0;
            let resolved = leaves.into_iter().map(|leaf| self.resolved(&leaf, is_inner));
            found.extend(resolved.map(|text| Named { line: line + 1, text, is_test }));
        }
        found
    }

    /// `super::…` as `crate::…`.
    fn resolved(&self, path: &str, is_inner: bool) -> String {
        let supers = path.split("::").take_while(|part| *part == "super").count();
        if supers == 0 {
            return path.to_owned();
        }
        let up = supers - usize::from(is_inner);
        let module = &self.module[..self.module.len() - up.min(self.module.len())];
        let rest = path.split("::").skip(supers).map(String::from);
        ["crate".to_string()].into_iter().chain(module.iter().cloned()).chain(rest).collect::<Vec<_>>().join("::")
    }
}

/// Whether `path` is `room` or below it.
fn is_within(path: &str, room: &str) -> bool {
    path.strip_prefix(room).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"))
}

/// Appends the leaves of the path or group at `start`, each after `prefix`; where they end.
fn leaves_of(code: &str, start: usize, prefix: String, leaves: &mut Vec<String>) -> usize {
    let skip = |at: usize| at + code[at..].len() - code[at..].trim_start().len();
    let mut at = skip(start);
    let mut path = prefix;
    loop {
        if code[at..].starts_with('{') {
            at += 1;
            while !code[at..].starts_with('}') {
                at = skip(leaves_of(code, at, path.clone(), leaves));
                at = skip(at + usize::from(code[at..].starts_with(',')));
            }
            return at + 1;
        }
        let end = if code[at..].starts_with('*') { at + 1 } else { word_end(code, at) };
        if end == at {
            leaves.push(path.trim_end_matches("::").to_owned()); // `::<`, or the end of a path
            return at;
        }
        path += &code[at..end];
        let after = skip(end);
        if !code[after..].starts_with("::") {
            leaves.push(path);
            let is_renamed = code[after..].starts_with("as ");
            return if is_renamed { word_end(code, skip(after + 2)) } else { end };
        }
        path += "::";
        at = skip(after + 2);
    }
}

/// Start of the first word at or after `from`.
fn next_word(code: &str, from: usize) -> Option<usize> {
    code[from..].find(|c: char| c.is_alphanumeric() || c == '_').map(|offset| from + offset)
}

/// End of the word at `start`.
fn word_end(code: &str, start: usize) -> usize {
    code[start..].find(|c: char| !c.is_alphanumeric() && c != '_').map_or(code.len(), |offset| start + offset)
}

/// Whether what follows `before` continues a path, a field or a lifetime.
fn is_continuation(before: &str) -> bool {
    before.ends_with("::") || before.ends_with('.') && !before.ends_with("..") || before.ends_with('\'')
}

/// The text with comments and the contents of strings and characters blanked, line breaks kept.
fn blanked(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if let Some(raw) = rest.strip_prefix("r#\"") {
            raw.find("\"#").map_or(rest.len(), |end| end + 5)
        } else if first == '"' {
            string_length(rest)
        } else if first == '\'' {
            character_length(rest)
        } else {
            out.push(first);
            rest = &rest[first.len_utf8()..];
            continue;
        };
        out.extend(rest[..length].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        rest = &rest[length..];
    }
    out
}

/// Bytes of the string literal at the start of `text`.
fn string_length(text: &str) -> usize {
    let mut is_escaped = false;
    for (i, c) in text.char_indices().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return i + 1,
            _ => {}
        }
    }
    text.len()
}

/// Bytes of the character literal at the start of `text`; 1 for the mark of a lifetime.
fn character_length(text: &str) -> usize {
    let inner: Vec<(usize, char)> = text.char_indices().skip(1).take(12).collect();
    match inner.as_slice() {
        [(_, '\\'), _, rest @ ..] => rest.iter().find(|(_, c)| *c == '\'').map_or(1, |(i, _)| i + 1),
        [_, (end, '\''), ..] => end + 1,
        _ => 1,
    }
}

/// Names of the dependencies in a `Cargo.toml` of this workspace, as code writes them.
fn dependencies(file: &str) -> BTreeSet<String> {
    let text = fs::read_to_string(root().join(file)).expect("a file of this repository");
    let document: toml::Table = text.parse().expect("Cargo accepts it");
    let unix = document.get("target").and_then(|t| t.get("cfg(unix)")).and_then(|t| t.get("dependencies"));
    let tables = ["dependencies", "dev-dependencies"].map(|key| document.get(key)).into_iter().chain([unix]);
    let names = tables.flatten().filter_map(toml::Value::as_table).flat_map(|table| table.keys());
    names.map(|name| name.replace('-', "_")).collect()
}

/// All files of Rust below a folder of this workspace.
fn sources(folder: &str) -> Vec<Source> {
    let base = root().join(folder);
    let mut found = Vec::new();
    collect(&base, &base, &mut found);
    assert!(found.len() > 5, "`{folder}` has source files");
    found
}

fn collect(base: &Path, folder: &Path, found: &mut Vec<Source>) {
    let entries = fs::read_dir(folder).expect("a folder of this repository");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            collect(base, &path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).expect("UTF-8");
            let inner = path.strip_prefix(base).expect("found below it").with_extension("");
            let words = inner.iter().map(|word| word.to_string_lossy().into_owned());
            let module = words.filter(|word| !["mod", "lib", "main"].contains(&word.as_str())).collect();
            found.push(Source::new(path, module, &text));
        }
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Fails with all faults, one a line.
fn expect_none(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}
