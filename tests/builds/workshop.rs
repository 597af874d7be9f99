//! What the tests of builds share: a project with colour and two levels, and what a run did.

use std::collections::BTreeSet;
use std::path::Path;

use image::{ImageFormat, Rgb, RgbImage};

use crate::project::{Project, Said, waves};

/// Everything that the asset of a surface depends on, in the words of a manifest.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Surface {
    pub(crate) name: &'static str,
    pub(crate) height: &'static str,
    pub(crate) color: Option<&'static str>,
    pub(crate) bsdf: &'static str,
    pub(crate) levels: &'static str,
    pub(crate) rank: usize,
    pub(crate) error: &'static str,
}

pub(crate) const DIFFUSE: &str = "{ type = \"diffuse\", albedo = [0.5, 0.4, 0.3] }";
pub(crate) const GLOSSY: &str = "{ type = \"conductor\", roughness = 0.4, specular = [0.9, 0.8, 0.7] }";

impl Surface {
    pub(crate) const PLAIN: Self = Self {
        name: "waves",
        height: "waves.png",
        color: None,
        bsdf: DIFFUSE,
        levels: "[4, 8]",
        rank: 1,
        error: "0.03",
    };

    pub(crate) fn manifest(&self) -> String {
        let Self { name, height, color, bsdf, levels, rank, error } = self;
        let color = color.map_or(String::new(), |color| format!("color = \"{color}\"\n"));
        format!(
            "[surface.{name}]\nheight = \"{height}\"\nsize = [0.048, 0.032]\namplitude = 0.002\nbsdf = {bsdf}\n{color}\
             levels = {levels}\npatches = 2\ndirections = 5\nrank = {rank}\nerror = {error}\n"
        )
    }
}

/// A project of `surface` with the map `waves.png` of 48 × 32 texels and the colour map `color.png`.
pub(crate) fn project(surface: &Surface) -> Project {
    let project = Project::empty();
    project.write("waves.png", &waves(48, 32));
    project.write("color.png", &stripes([200, 120, 40]));
    project.write("farfield.toml", surface.manifest().as_bytes());
    project
}

/// A colour map of 8 × 8 texels, every other column in `rgb`.
pub(crate) fn stripes(rgb: [u8; 3]) -> Vec<u8> {
    let image = RgbImage::from_fn(8, 8, |u, _| if u % 2 == 0 { Rgb(rgb) } else { Rgb([90; 3]) });
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// The actions that ran, by what a build with `--explain --json` says; names of surfaces left out.
pub(crate) fn ran(said: &Said) -> Vec<String> {
    let lines = said.stdout.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    lines.filter_map(|line| Some(line.get("ran")?.as_str()?.to_string())).collect()
}

/// The stages that ran, levels left out.
pub(crate) fn stages(said: &Said) -> BTreeSet<String> {
    ran(said).iter().map(|action| action.rsplit(' ').next().unwrap().to_string()).collect()
}

/// A build that succeeds, with arguments besides.
pub(crate) fn build(project: &Project, arguments: &[&str]) -> Said {
    let said = project.run(&[&["build", "-q", "--explain", "--json"], arguments].concat());
    assert_eq!(said.code, 0, "{said:?}");
    said
}

/// Copies a folder with all that is in it, times left out.
pub(crate) fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let place = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &place);
        } else {
            std::fs::copy(entry.path(), place).unwrap();
        }
    }
}

/// A project that has been built once; all come from one build.
pub(crate) fn built() -> Project {
    static FIRST: std::sync::OnceLock<Project> = std::sync::OnceLock::new();
    let first = FIRST.get_or_init(|| {
        let project = project(&Surface { color: Some("color.png"), ..Surface::PLAIN });
        build(&project, &[]);
        project
    });
    let project = Project::empty();
    copy(first.path(), project.path());
    project
}
