//! An asset in a folder.

use super::decode::{fetch_checked, files_of};
use super::document::{Document, MAX_DOCUMENT_LENGTH};
use super::{DOCUMENT, SurfaceAsset};
use crate::{Error, ktx2};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// One payload file of an asset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PayloadFile {
    /// Level that it belongs to.
    pub level: u32,
    /// Meaning: `heights`, `lobe0`…, `base_color`, `spatial0`…, `angular0`….
    pub role: String,
    /// File name within the asset's folder.
    pub path: String,
    /// BLAKE3 of the bytes, 64 hex digits.
    pub digest: String,
    /// Length in bytes.
    pub bytes: u64,
}

impl SurfaceAsset {
    /// The asset in the folder `dir`.
    ///
    /// No more of a file is read than its content can need.
    pub fn read(dir: &Path) -> Result<Self, Error> {
        Self::decode_bounded(&mut |path, most| read_bounded(dir, path, most))
    }

    /// The payload files of the asset in the folder `dir`, their digests checked.
    pub fn files(dir: &Path) -> Result<Vec<PayloadFile>, Error> {
        let document = Document::parse(&read_bounded(dir, DOCUMENT, MAX_DOCUMENT_LENGTH)?)?;
        let mut found = Vec::new();
        for level in &document.levels {
            for (role, file) in files_of(level)? {
                let most = ktx2::max_file_length(role.format(), level.shape().size(role));
                let bytes = fetch_checked(file, most, &mut |path, most| read_bounded(dir, path, most))?.len() as u64;
                found.push(PayloadFile {
                    level: level.index,
                    role: file.role.clone(),
                    path: file.path.clone(),
                    digest: file.digest.clone(),
                    bytes,
                });
            }
        }
        Ok(found)
    }
}

pub(crate) fn read_bounded(dir: &Path, name: &str, most: u64) -> Result<Vec<u8>, Error> {
    let path = dir.join(name);
    let fail = |source: io::Error| Error::Io { path: path.clone(), source };
    // Asked before opening: opening a pipe would wait for its writer.
    let metadata = fs::metadata(&path).map_err(fail)?;
    if !metadata.is_file() {
        let found = if metadata.is_dir() { "a directory" } else { "a device or pipe" };
        return Err(Error::malformed(&path.display().to_string(), "kind of file", "a plain file", found));
    }
    let mut bytes = Vec::new();
    File::open(&path).and_then(|file| file.take(most + 1).read_to_end(&mut bytes)).map_err(fail)?;
    if bytes.len() as u64 > most {
        let (wanted, found) = (format!("at most {most} bytes"), format!("{} bytes", metadata.len()));
        return Err(Error::malformed(&path.display().to_string(), "length", wanted, found));
    }
    Ok(bytes)
}
