//! `farfield inspect`.

use std::path::Path;

use formats::asset::{DOCUMENT, PayloadFile, SurfaceAsset};

use super::args::InspectArgs;
use super::{DONE, FAILED, complain, print};
use crate::build::{LevelRecord, record};
use crate::io::SourceFile;
use crate::report::{self, Inspected};

/// Shows an asset; the exit code.
pub(super) fn run(args: &InspectArgs) -> u8 {
    match open(&args.asset) {
        Ok(inspected) if args.json => print(&report::asset_json(&inspected)),
        Ok(inspected) => print(&report::asset_text(&inspected)),
        Err(line) => {
            complain("error", &line);
            return FAILED;
        }
    }
    DONE
}

/// The asset in a folder, or whose `asset.json` is given, with every hash checked; the error is one line.
fn open(path: &Path) -> Result<Inspected, String> {
    let folder = if path.is_file() { path.parent().unwrap_or(Path::new("")) } else { path };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let document = SourceFile::read(&folder.join(DOCUMENT))
        .map_err(|error| format!("{error}; wanted the folder of an asset, as in `lod/NAME`"))?;
    let in_folder = |error: formats::Error| match error {
        formats::Error::Io { .. } => error.to_string(),
        _ => format!("{}: {error}", folder.display()),
    };
    let asset = SurfaceAsset::read(folder).map_err(in_folder)?;
    let files: Vec<PayloadFile> = SurfaceAsset::files(folder).map_err(in_folder)?;
    let digest = blake3::hash(document.bytes()).to_hex().to_string();
    let records: Vec<LevelRecord> = std::path::absolute(folder)
        .ok()
        .and_then(|folder| folder.parent().map(record::read))
        .unwrap_or_default()
        .into_iter()
        .filter(|record| record.asset == digest)
        .collect();
    Ok(Inspected { asset, files, records, document_bytes: document.bytes().len() as u64 })
}
