//! A file, read once: the bytes that are hashed are the bytes that are decoded.

use std::fs::{File, Metadata};
use std::io::Read;
use std::path::Path;

use super::Error;

/// The longest file that is read: 16384² texels of four floats, and as much again for coarser levels and headers.
pub(super) const MAX_BYTES: u64 = 8 << 30;

/// The bytes of a file and the name that its user knows it by.
#[derive(Clone, Debug)]
pub struct SourceFile {
    name: String,
    bytes: Vec<u8>,
}

impl SourceFile {
    /// Reads the file at `path`.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let name = path.display().to_string();
        let length = checked(path)?.len();
        let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
        // A file that grows while it is read stays within the limit.
        let read = File::open(path).and_then(|file| file.take(MAX_BYTES).read_to_end(&mut bytes));
        read.map_err(|cause| Error::system(&name, "read", cause))?;
        Ok(Self { name, bytes })
    }

    /// BLAKE3 of the bytes that [`Self::read`] would read, which are not kept.
    pub fn digest(path: &Path) -> Result<blake3::Hash, Error> {
        checked(path)?;
        let mut hasher = blake3::Hasher::new();
        let hashed = File::open(path).and_then(|file| hasher.update_reader(file.take(MAX_BYTES)).map(drop));
        hashed.map_err(|cause| Error::system(&path.display().to_string(), "read", cause))?;
        Ok(hasher.finalize())
    }

    /// The given bytes under a name, as if read from a file.
    pub fn from_bytes(name: impl Into<String>, bytes: Vec<u8>) -> Self {
        Self { name: name.into(), bytes }
    }

    /// The name for messages: the path as it was given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What the file holds.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// What the system says of the file at `path`, if it is one and not too long.
fn checked(path: &Path) -> Result<Metadata, Error> {
    let name = path.display().to_string();
    let metadata = std::fs::metadata(path).map_err(|cause| Error::system(&name, "read", cause))?;
    if !metadata.is_file() {
        // Pipes and devices have no length to hold a header against, and may never end.
        let found = if metadata.is_dir() { "directory" } else { "special file" };
        return Err(Error::NotAFile { file: name, found });
    }
    if metadata.len() > MAX_BYTES {
        return Err(Error::TooLong { file: name, bytes: metadata.len() });
    }
    Ok(metadata)
}
