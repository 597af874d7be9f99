//! An asset as the bytes of its files.

use super::document::{Document, FileDocument, LevelDocument, MAX_DOCUMENT_LENGTH};
use super::payload::{Shape, texels};
use super::{DOCUMENT, SurfaceAsset, SurfaceLevel};
use crate::{Error, ktx2};
use std::collections::BTreeMap;

impl SurfaceAsset {
    /// The bytes of every file by name, `asset.json` included; the same bytes for the same asset.
    ///
    /// A payload's name carries its content, so a new asset may be written beside the old one: payloads first,
    /// `asset.json` replaced last. Values are rounded to what the format holds; what it cannot hold is an error that
    /// names role and index.
    pub fn encode(&self) -> Result<BTreeMap<String, Vec<u8>>, Error> {
        let mut files = BTreeMap::new();
        let levels = self.levels.iter().map(|level| encode_level(level, &mut files)).collect::<Result<_, _>>()?;
        let document = Document::new(self, levels);
        document.check().map_err(|fault| Error::shape(fault.place, fault.wanted, fault.found))?;
        // No newline at the end: so every truncation of the file is one of its JSON.
        let json = serde_json::to_vec_pretty(&document).expect("a tree with string keys is JSON");
        if json.len() as u64 > MAX_DOCUMENT_LENGTH {
            let wanted = format!("at most {MAX_DOCUMENT_LENGTH} bytes of `{DOCUMENT}`");
            return Err(Error::shape("settings, versions and levels", wanted, format!("{} bytes", json.len())));
        }
        files.insert(DOCUMENT.into(), json);
        Ok(files)
    }
}

fn encode_level(level: &SurfaceLevel, files: &mut BTreeMap<String, Vec<u8>>) -> Result<LevelDocument, Error> {
    check_shape(level)?;
    let shape = Shape::of(level);
    let mut entries = Vec::new();
    for role in shape.roles() {
        let bytes = ktx2::write(&texels(level, role)?, shape.size(role));
        let digest = blake3::hash(&bytes).to_hex();
        let path = format!("level{}.{}.{}.ktx2", level.index, role.name(), &digest[..16]);
        entries.push(FileDocument { role: role.name(), path: path.clone(), digest: digest.to_string() });
        files.insert(path, bytes);
    }
    Ok(LevelDocument::new(level, entries))
}

/// Every array of the level has as many values as the level's counts say.
fn check_shape(level: &SurfaceLevel) -> Result<(), Error> {
    let expect = |role: String, wanted: usize, found: usize| {
        if wanted == found {
            return Ok(());
        }
        let values = |count: usize| format!("{count} values");
        Err(Error::shape(format!("level {}, {role}", level.index), values(wanted), values(found)))
    };
    let cells = level.cells[0].saturating_mul(level.cells[1]);
    let patches = level.patches[0].saturating_mul(level.patches[1]);
    let pairs = level.directions.saturating_pow(4);
    expect("heights".into(), cells, level.heights.len())?;
    for (lobe, values) in level.lobes.iter().enumerate() {
        expect(format!("lobe{lobe}"), cells, values.len())?;
    }
    if let Some(colors) = &level.base_color {
        expect("base_color".into(), cells, colors.len())?;
    }
    for (rank, values) in level.spatial.iter().enumerate() {
        expect(format!("spatial{rank}"), patches, values.len())?;
    }
    expect("rank of S (that of T wanted)".into(), level.spatial.len(), level.angular.len())?;
    for (rank, values) in level.angular.iter().enumerate() {
        expect(format!("angular{rank}"), pairs, values.len())?;
    }
    if let Some(term) = &level.additive {
        expect("additive_spatial".into(), patches, term.spatial.len())?;
        expect("additive_angular".into(), term.directions.saturating_pow(4), term.angular.len())?;
    }
    Ok(())
}
