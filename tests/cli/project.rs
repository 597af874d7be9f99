//! A temporary folder with maps and a manifest, and the binary run in it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use farfield::io::heights::encode_png16;
use tempfile::TempDir;

/// A temporary folder, removed at the end of its test.
pub(crate) struct Project {
    folder: TempDir,
}

/// What a run of the binary said.
#[derive(Debug)]
pub(crate) struct Said {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Project {
    /// An empty folder.
    pub(crate) fn empty() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// A folder with the map `waves.png` and a manifest that builds it.
    pub(crate) fn waves() -> Self {
        let project = Self::empty();
        project.write("waves.png", &waves(48, 32));
        project.write("farfield.toml", surface("waves", "waves.png").as_bytes());
        project
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// The binary with these arguments, in the folder.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_farfield"));
        command.args(arguments).current_dir(self.path());
        command
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Said {
        said(self.command(arguments).output().unwrap())
    }

    /// Names of all files below `folder`, sorted, with their bytes.
    pub(crate) fn tree(&self, folder: &str) -> Vec<(String, Vec<u8>)> {
        let mut found = Vec::new();
        collect(&self.path().join(folder), String::new(), &mut found);
        found.sort();
        found
    }
}

/// What the process said.
pub(crate) fn said(output: Output) -> Said {
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Said { code: output.status.code().unwrap_or(-1), stdout: text(output.stdout), stderr: text(output.stderr) }
}

fn collect(folder: &Path, prefix: String, found: &mut Vec<(String, Vec<u8>)>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = prefix.clone() + &entry.file_name().to_string_lossy();
        if entry.path().is_dir() {
            collect(&entry.path(), name + "/", found);
        } else {
            found.push((name, std::fs::read(entry.path()).unwrap()));
        }
    }
}

/// A manifest entry with the map `height`.
pub(crate) fn surface(name: &str, height: &str) -> String {
    format!(
        "[surface.{name}]\nheight = \"{height}\"\nsize = [0.048, 0.032]\namplitude = 0.002\n\
         bsdf = {{ type = \"diffuse\", albedo = [0.5, 0.4, 0.3] }}\nlevels = [4, 8]\npatches = 2\ndirections = 7\nrank = 1\n"
    )
}

/// A tileable 16-bit map as PNG.
pub(crate) fn waves(width: u32, height: u32) -> Vec<u8> {
    encode_png16(&wave_codes(width, height), width, height)
}

/// Its codes.
pub(crate) fn wave_codes(width: u32, height: u32) -> Vec<u16> {
    let wave = |i: u32, n: u32| (std::f64::consts::TAU * 2.0 * f64::from(i) / f64::from(n)).sin();
    let code = |u, v| ((wave(u, width) + wave(v, height) + 2.0) / 4.0 * 65535.0).round() as u16;
    (0..width * height).map(|i| code(i % width, i / width)).collect()
}
