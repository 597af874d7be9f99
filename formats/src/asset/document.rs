//! `asset.json` as serde sees it: its keys in their order, and the checks that need no payload.

use super::payload::Shape;
use super::*;
use crate::Error;
use crate::cell_brdf::Specular;

/// Value of `format`.
pub(crate) const FORMAT: &str = "farfield";
/// Value of `kind`.
const KIND: &str = "surface";
/// Most bytes of `asset.json`; real ones have a few kilobytes a level.
pub(crate) const MAX_DOCUMENT_LENGTH: u64 = 1 << 20;

/// The keys that say how to read the others.
#[derive(Deserialize)]
pub(crate) struct Preamble {
    format: String,
    version: u64,
    pub(crate) kind: String,
}

#[derive(Serialize, Deserialize)]
pub(super) struct Document {
    format: String,
    version: u32,
    kind: String,
    name: String,
    light: Light,
    size: [f64; 2],
    boundary: Boundary,
    source: Source,
    bsdf: BsdfDocument,
    settings: serde_json::Value,
    versions: BTreeMap<String, String>,
    seed: u64,
    isa: String,
    pub(super) levels: Vec<LevelDocument>,
}

#[derive(Serialize, Deserialize)]
struct BsdfDocument {
    diffuse: [f32; 3],
    specular: Option<SpecularDocument>,
}

#[derive(Serialize, Deserialize)]
struct SpecularDocument {
    f0: [f32; 3],
    alpha: f32,
    gaussians: Vec<[f32; 2]>,
}

#[derive(Serialize, Deserialize)]
pub(super) struct LevelDocument {
    pub(super) index: u32,
    pub(super) factor: [f64; 2],
    cells: [usize; 2],
    pub(super) files: Vec<FileDocument>,
    lobes: usize,
    #[serde(rename = "M")]
    patches: [usize; 2],
    #[serde(rename = "N")]
    directions: usize,
    rank: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    additive: Option<AdditiveDocument>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) skipped_interreflection: Option<f64>,
    pub(super) error: Option<LevelError>,
    pub(super) limited_by: Option<String>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) alternatives: Vec<Alternative>,
}

#[derive(Serialize, Deserialize)]
struct AdditiveDocument {
    #[serde(rename = "N")]
    directions: usize,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct FileDocument {
    pub(crate) role: String,
    pub(crate) path: String,
    pub(crate) digest: String,
}

impl Document {
    pub(super) fn new(asset: &SurfaceAsset, levels: Vec<LevelDocument>) -> Self {
        let specular = asset.bsdf.specular.as_ref();
        Self {
            format: FORMAT.into(),
            version: VERSION,
            kind: KIND.into(),
            name: asset.name.clone(),
            light: asset.light,
            size: asset.size,
            boundary: asset.boundary,
            source: asset.source.clone(),
            bsdf: BsdfDocument {
                diffuse: asset.bsdf.diffuse,
                specular: specular.map(|s| SpecularDocument {
                    f0: s.f0,
                    alpha: s.alpha,
                    gaussians: s.gaussians.clone(),
                }),
            },
            settings: asset.settings.clone(),
            versions: asset.versions.clone(),
            seed: asset.seed,
            isa: asset.isa.clone(),
            levels,
        }
    }

    /// The document in `bytes`, its counts and numbers checked.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Error> {
        let document: Self = parse_document(bytes, KIND)?;
        document.check().map_err(|fault| Error::malformed(DOCUMENT, fault.place, fault.wanted, fault.found))?;
        Ok(document)
    }

    /// The asset without its levels.
    pub(super) fn into_asset(self, levels: Vec<SurfaceLevel>) -> SurfaceAsset {
        let specular = self.bsdf.specular;
        SurfaceAsset {
            name: self.name,
            light: self.light,
            size: self.size,
            boundary: self.boundary,
            source: self.source,
            bsdf: BaseBrdf {
                diffuse: self.bsdf.diffuse,
                specular: specular.map(|s| Specular { f0: s.f0, alpha: s.alpha, gaussians: s.gaussians }),
            },
            settings: self.settings,
            versions: self.versions,
            seed: self.seed,
            isa: self.isa,
            levels,
        }
    }

    /// The same checks for writer and reader: whatever is written can be read.
    pub(super) fn check(&self) -> Result<(), Fault> {
        /// Range of lengths in metres: an atom and a light year, so that squares and quotients stay finite.
        const LENGTHS: [f64; 2] = [1e-10, 1e16];
        for (axis, &metres) in self.size.iter().enumerate() {
            within(format!("`size`[{axis}] in metres"), metres, LENGTHS[0], LENGTHS[1])?;
        }
        for (key, texels) in [("width", self.source.width), ("height", self.source.height)] {
            within(format!("`source.{key}`"), texels, 1, MAX_CELLS as u32)?;
        }
        if !is_digest(&self.source.digest) {
            return Err(Fault::new("`source.digest`", "64 hex digits", format!("`{}`", self.source.digest)));
        }
        self.bsdf.check()?;
        within("number of `levels`", self.levels.len(), 0, MAX_LEVELS)?;
        for pair in self.levels.windows(2) {
            within("`index` of a level", pair[1].index, pair[0].index.saturating_add(1), u32::MAX)?;
        }
        self.levels.iter().try_for_each(LevelDocument::check)
    }
}

impl BsdfDocument {
    fn check(&self) -> Result<(), Fault> {
        /// Λ of the narrowest Gaussian, α = 0.002, and amplitudes of D up to 1/(πα²), with room.
        const MAX_GAUSSIAN: f32 = 1e9;
        for value in self.diffuse {
            within("`bsdf.diffuse`", value, 0.0, MAX_HALF)?;
        }
        let Some(specular) = &self.specular else { return Ok(()) };
        for value in specular.f0 {
            within("`bsdf.specular.f0`", value, 0.0, MAX_HALF)?;
        }
        within("`bsdf.specular.alpha`", specular.alpha, f32::MIN_POSITIVE, 1.0)?;
        within("number of `bsdf.specular.gaussians`", specular.gaussians.len(), 1, 64)?;
        for value in specular.gaussians.iter().flatten() {
            within("`bsdf.specular.gaussians`", *value, 0.0, MAX_GAUSSIAN)?;
        }
        Ok(())
    }
}

impl LevelDocument {
    pub(super) fn new(level: &SurfaceLevel, files: Vec<FileDocument>) -> Self {
        Self {
            index: level.index,
            factor: level.factor,
            cells: level.cells,
            files,
            lobes: level.lobes.len(),
            patches: level.patches,
            directions: level.directions,
            rank: level.spatial.len(),
            additive: level.additive.as_ref().map(|term| AdditiveDocument { directions: term.directions }),
            skipped_interreflection: level.skipped_interreflection,
            error: level.error,
            limited_by: level.limited_by.clone(),
            alternatives: level.alternatives.clone(),
        }
    }

    pub(super) fn shape(&self) -> Shape {
        Shape {
            cells: self.cells,
            lobes: self.lobes,
            has_color: self.files.iter().any(|file| file.role == "base_color"),
            patches: self.patches,
            directions: self.directions,
            rank: self.rank,
            additive: self.additive.as_ref().map(|term| term.directions),
        }
    }

    fn check(&self) -> Result<(), Fault> {
        /// More than all that can be combined.
        const MAX_ALTERNATIVES: usize = 256;
        /// No error figure is larger, whatever was compiled.
        const MAX_FIGURE: f64 = 1e30;
        let key = |name: &str| format!("level {}, `{name}`", self.index);
        within(key("index"), self.index, 1, u32::MAX)?;
        for axis in 0..2 {
            within(key("factor"), self.factor[axis], 1.0, MAX_CELLS as f64)?;
            within(key("cells"), self.cells[axis], 1, MAX_CELLS)?;
            within(key("M"), self.patches[axis], 1, MAX_PATCHES.min(self.cells[axis]))?;
        }
        within(key("lobes"), self.lobes, 1, MAX_LOBES)?;
        within(key("N"), self.directions, 1, MAX_DIRECTIONS)?;
        within(key("rank"), self.rank, 1, MAX_RANK)?;
        if let Some(term) = &self.additive {
            within(key("additive.N"), term.directions, 1, MAX_DIRECTIONS)?;
        }
        if let Some(bound) = self.skipped_interreflection {
            within(key("skipped_interreflection"), bound, 0.0, 1.0)?;
        }
        for (name, figure) in self.error.iter().flat_map(LevelError::figures) {
            within(key(name), figure.value, -MAX_FIGURE, MAX_FIGURE)?;
            within(key(name), figure.standard_error, 0.0, MAX_FIGURE)?;
        }
        within(key("alternatives"), self.alternatives.len(), 0, MAX_ALTERNATIVES)?;
        for alternative in &self.alternatives {
            within(key("error of an alternative"), alternative.error, 0.0, MAX_FIGURE)?;
        }
        Ok(())
    }
}

/// The keys of `asset.json` for an asset of this kind, its preamble checked first.
pub(crate) fn parse_document<T: serde::de::DeserializeOwned>(bytes: &[u8], kind: &str) -> Result<T, Error> {
    let preamble = parse_preamble(bytes)?;
    if preamble.kind != kind {
        return Err(Error::malformed(DOCUMENT, "`kind`", kind, preamble.kind));
    }
    serde_json::from_slice(bytes).map_err(syntax)
}

/// The kind that `asset.json` names; its format and version are those that this crate reads.
pub(crate) fn parse_preamble(bytes: &[u8]) -> Result<Preamble, Error> {
    if bytes.len() as u64 > MAX_DOCUMENT_LENGTH {
        let wanted = format!("at most {MAX_DOCUMENT_LENGTH} bytes");
        return Err(Error::malformed(DOCUMENT, "length", wanted, format!("{} bytes", bytes.len())));
    }
    let preamble: Preamble = serde_json::from_slice(bytes).map_err(syntax)?;
    let expect = |place, wanted: String, found: &str| {
        if wanted == found { Ok(()) } else { Err(Error::malformed(DOCUMENT, place, wanted, found)) }
    };
    expect("`format`", FORMAT.into(), &preamble.format)?;
    expect("`version`", VERSION.to_string(), &preamble.version.to_string())?;
    Ok(preamble)
}

/// JSON that is not what serde was asked for.
fn syntax(error: serde_json::Error) -> Error {
    let place = format!("line {}, column {}", error.line(), error.column());
    Error::malformed(DOCUMENT, place, "a farfield asset of version 1", error)
}

/// What is wrong with a document, by whomever it was made.
pub(crate) struct Fault {
    pub(crate) place: String,
    pub(crate) wanted: String,
    pub(crate) found: String,
}

impl Fault {
    pub(crate) fn new(place: impl Into<String>, wanted: impl ToString, found: impl ToString) -> Self {
        Self { place: place.into(), wanted: wanted.to_string(), found: found.to_string() }
    }
}

/// Refuses what is outside [low, high], and NaN.
pub(crate) fn within<T: PartialOrd + std::fmt::Debug>(
    place: impl Into<String>,
    value: T,
    low: T,
    high: T,
) -> Result<(), Fault> {
    if (&low..=&high).contains(&&value) {
        return Ok(());
    }
    Err(Fault::new(place, format!("{low:?} to {high:?}"), format!("{value:?}")))
}

pub(crate) fn is_digest(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}
