//! `farfield inspect`.

use std::path::Path;

use formats::VolumeAsset;
use formats::asset::{DOCUMENT, Kind, PayloadFile, SurfaceAsset};

use super::args::InspectArgs;
use super::{DONE, FAILED, complain, print};
use crate::build::{LevelRecord, record};
use crate::io::SourceFile;
use crate::report::{self, Inspected, InspectedVolume};

/// Shows an asset; the exit code.
pub(super) fn run(args: &InspectArgs) -> u8 {
    match show(&args.asset, args.json) {
        Ok(text) => print(&text),
        Err(line) => {
            complain("error", &line);
            return FAILED;
        }
    }
    DONE
}

/// What is in the asset in a folder, or whose `asset.json` is given, with every hash checked; the error is one line.
fn show(path: &Path, as_json: bool) -> Result<String, String> {
    let folder = if path.is_file() { path.parent().unwrap_or(Path::new("")) } else { path };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let document = SourceFile::read(&folder.join(DOCUMENT))
        .map_err(|error| format!("{error}; wanted the folder of an asset, as in `lod/NAME`"))?;
    let in_folder = |error: formats::Error| match error {
        formats::Error::Io { .. } => error.to_string(),
        _ => format!("{}: {error}", folder.display()),
    };
    let shown = match Kind::of(document.bytes()).map_err(in_folder)? {
        Kind::Surface => show_surface(folder, &document, as_json),
        Kind::Volume => show_volume(folder, &document, as_json),
    };
    shown.map_err(in_folder)
}

/// The surface asset in `folder`.
fn show_surface(folder: &Path, document: &SourceFile, as_json: bool) -> Result<String, formats::Error> {
    let asset = SurfaceAsset::read(folder)?;
    let files: Vec<PayloadFile> = SurfaceAsset::files(folder)?;
    let digest = blake3::hash(document.bytes()).to_hex().to_string();
    let records: Vec<LevelRecord> = std::path::absolute(folder)
        .ok()
        .and_then(|folder| folder.parent().map(record::read))
        .unwrap_or_default()
        .into_iter()
        .filter(|record| record.asset == digest)
        .collect();
    let inspected = Inspected { asset, files, records, document_bytes: document.bytes().len() as u64 };
    Ok(if as_json { report::asset_json(&inspected) } else { report::asset_text(&inspected) })
}

/// The volume asset in `folder`.
fn show_volume(folder: &Path, document: &SourceFile, as_json: bool) -> Result<String, formats::Error> {
    let (asset, files) = (VolumeAsset::read(folder)?, VolumeAsset::files(folder)?);
    let inspected = InspectedVolume { asset, files, document_bytes: document.bytes().len() as u64 };
    Ok(if as_json { report::volume_json(&inspected) } else { report::volume_text(&inspected) })
}
