//! What a command line asks for: the surfaces and volumes of a manifest that are to be built, or a scene that is to be drawn.

use std::path::{Path, PathBuf};

use super::manifest::{Manifest, ObjectSpec, closest};
use super::{Mistake, SceneSpec, SurfaceSpec, VolumeSpec};
use crate::io::SourceFile;

/// The longest manifest that is read.
const MAX_MANIFEST_BYTES: usize = 16 << 20;

/// Surfaces and volumes to build and the folder that their paths are relative to.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The chosen surfaces, by name.
    pub surfaces: Vec<SurfaceSpec>,
    /// The chosen volumes, by name.
    pub volumes: Vec<VolumeSpec>,
    /// The manifest's folder.
    pub folder: PathBuf,
}

/// Why a request makes no sense.
#[derive(Debug)]
#[non_exhaustive]
pub enum PlanError {
    /// The manifest cannot be read.
    Unreadable(String),
    /// The manifest has mistakes.
    Mistakes {
        /// The manifest.
        file: String,
        /// All of them, in order of place.
        mistakes: Vec<Mistake>,
    },
    /// A name that the manifest does not have.
    UnknownNames(Vec<String>),
}

impl PlanError {
    /// One line a mistake.
    pub fn lines(&self) -> Vec<String> {
        match self {
            Self::Unreadable(line) => vec![line.clone()],
            Self::Mistakes { file, mistakes } => mistakes.iter().map(|mistake| format!("{file}:{mistake}")).collect(),
            Self::UnknownNames(lines) => lines.clone(),
        }
    }
}

impl Plan {
    /// The surfaces and volumes `names` of the manifest at `path`; all of them where `names` is empty.
    pub fn read(path: &Path, names: &[String]) -> Result<Self, PlanError> {
        let (manifest, file) = read_manifest(path)?;
        let Manifest { mut surfaces, mut volumes, .. } = manifest;
        if !names.is_empty() {
            check_names(&surfaces, &volumes, names, &file)?;
            surfaces.retain(|surface| names.contains(&surface.name));
            volumes.retain(|volume| names.contains(&volume.name));
        }
        Ok(Self { surfaces, volumes, folder: folder_of(path) })
    }

    /// The plan with another target for everything.
    pub fn with_error(mut self, error: f64) -> Self {
        self.surfaces.iter_mut().flat_map(|surface| &mut surface.levels).for_each(|level| level.error = error);
        self.volumes.iter_mut().for_each(|volume| volume.error = error);
        self
    }
}

/// A scene to draw, with the surfaces and volumes in it and the folder that its paths are relative to.
#[derive(Clone, Debug)]
pub struct ScenePlan {
    /// The scene.
    pub scene: SceneSpec,
    /// The surfaces that its objects name, each once, in the manifest's order.
    pub surfaces: Vec<SurfaceSpec>,
    /// The volumes that its objects name.
    pub volumes: Vec<VolumeSpec>,
    /// The manifest's folder.
    pub folder: PathBuf,
}

impl ScenePlan {
    /// The scene `name` of the manifest at `path`.
    pub fn read(path: &Path, name: &str) -> Result<Self, PlanError> {
        let (manifest, file) = read_manifest(path)?;
        let known: Vec<&str> = manifest.scenes.iter().map(|scene| scene.name.as_str()).collect();
        let Some(index) = known.iter().position(|known| *known == name) else {
            return Err(PlanError::UnknownNames(vec![unknown_name("scene", name, &known, &file)]));
        };
        let Manifest { mut surfaces, mut volumes, mut scenes } = manifest;
        let scene = scenes.swap_remove(index);
        let is_shown = |name: &str| {
            scene.objects.iter().any(|object| match object {
                ObjectSpec::Surface(plane) => plane.surface == name,
                ObjectSpec::Volume { volume } => volume == name,
            })
        };
        surfaces.retain(|surface| is_shown(&surface.name));
        volumes.retain(|volume| is_shown(&volume.name));
        Ok(Self { scene, surfaces, volumes, folder: folder_of(path) })
    }
}

/// The manifest at `path`, and the file's name for messages.
fn read_manifest(path: &Path) -> Result<(Manifest, String), PlanError> {
    let file = SourceFile::read(path).map_err(|error| {
        let hint = if path.exists() { "" } else { "; `farfield init` makes one, `-m FILE` names another" };
        PlanError::Unreadable(format!("{error}{hint}"))
    })?;
    if file.bytes().len() > MAX_MANIFEST_BYTES {
        let found = file.bytes().len();
        let line = format!("`{}`: has {found} bytes; wanted a manifest of at most 16 MiB", file.name());
        return Err(PlanError::Unreadable(line));
    }
    let text = std::str::from_utf8(file.bytes()).map_err(|error| {
        let line = format!("`{}`: byte {} is not UTF-8; wanted a text file", file.name(), error.valid_up_to());
        PlanError::Unreadable(line)
    })?;
    match Manifest::parse(text) {
        Ok(manifest) => Ok((manifest, file.name().into())),
        Err(mistakes) => Err(PlanError::Mistakes { file: file.name().into(), mistakes }),
    }
}

/// The folder that paths in the manifest at `path` are relative to.
fn folder_of(path: &Path) -> PathBuf {
    path.parent().unwrap_or(Path::new("")).to_owned()
}

/// Fails with all of `names` that are neither a surface nor a volume.
fn check_names(
    surfaces: &[SurfaceSpec],
    volumes: &[VolumeSpec],
    names: &[String],
    file: &str,
) -> Result<(), PlanError> {
    let kind = if volumes.is_empty() { "surface" } else { "surface or volume" };
    let volumes = volumes.iter().map(|volume| volume.name.as_str());
    let known: Vec<&str> = surfaces.iter().map(|surface| surface.name.as_str()).chain(volumes).collect();
    let unknown = names.iter().filter(|name| !known.contains(&name.as_str()));
    let lines: Vec<String> = unknown.map(|name| unknown_name(kind, name, &known, file)).collect();
    if lines.is_empty() { Ok(()) } else { Err(PlanError::UnknownNames(lines)) }
}

/// That `file` has no `[KIND.NAME]` of this name.
fn unknown_name(kind: &str, name: &str, known: &[&str], file: &str) -> String {
    let hint = match closest(name, known) {
        Some(near) => format!("did you mean `{near}`?"),
        None if known.is_empty() => format!("wanted a `[{kind}.{name}]` table"),
        None => format!("it has `{}`", known.join("`, `")),
    };
    format!("`{file}` has no {kind} `{name}`; {hint}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Surfaces `bark`, `cloth`, `gravel`; scenes `shelf` of cloth and `shop` of bark.
    fn manifest() -> String {
        let surface = |name: &str| {
            format!(
                "[surface.{name}]\nheight = \"{name}.png\"\nsize = [1, 1]\namplitude = 0.1\nlevels = [8]\n\
                 bsdf = {{ type = \"diffuse\", albedo = [0.5, 0.5, 0.5] }}\n"
            )
        };
        let scene = |name: &str, surface: &str| {
            format!(
                "[scene.{name}]\ncamera = {{ position = [0, 1, 1], target = [0, 0, 0], fov = 40 }}\n\
                 lights = [{{ type = \"constant\", radiance = [1, 1, 1] }}]\n\
                 objects = [{{ mesh = \"plane\", surface = \"{surface}\" }}]\n"
            )
        };
        ["gravel", "cloth", "bark"].map(surface).concat() + &scene("shop", "bark") + &scene("shelf", "cloth")
    }

    #[test]
    fn a_scene_comes_with_its_surfaces_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("farfield.toml");
        std::fs::write(&path, manifest()).unwrap();
        for (name, surface) in [("shop", "bark"), ("shelf", "cloth")] {
            let plan = ScenePlan::read(&path, name).unwrap();
            assert_eq!((plan.scene.name.as_str(), plan.folder.as_path()), (name, folder.path()));
            let names: Vec<&str> = plan.surfaces.iter().map(|surface| surface.name.as_str()).collect();
            assert_eq!(names, [surface]);
        }
        assert_eq!(Plan::read(&path, &[]).unwrap().surfaces.len(), 3);
    }

    #[test]
    fn names_that_are_not_there_are_told_apart() {
        let known = ["shelf", "shop"];
        for (name, known, wanted) in [
            ("shpo", &known[..], "`a.toml` has no scene `shpo`; it has `shelf`, `shop`"),
            ("shep", &known[..], "`a.toml` has no scene `shep`; did you mean `shop`?"),
            ("Shelf", &known[..], "`a.toml` has no scene `Shelf`; did you mean `shelf`?"),
            ("shop", &[][..], "`a.toml` has no scene `shop`; wanted a `[scene.shop]` table"),
        ] {
            assert_eq!(unknown_name("scene", name, known, "a.toml"), wanted);
        }
    }
}
