//! A file, read once: the bytes that are hashed are the bytes that are decoded.

use std::fs::File;
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
        let fail = |cause| Error::system(&name, "read", cause);
        let metadata = std::fs::metadata(path).map_err(fail)?;
        if !metadata.is_file() {
            // Pipes and devices have no length to hold a header against, and may never end.
            let found = if metadata.is_dir() { "directory" } else { "special file" };
            return Err(Error::NotAFile { file: name, found });
        }
        if metadata.len() > MAX_BYTES {
            return Err(Error::TooLong { file: name, bytes: metadata.len() });
        }
        let mut bytes = Vec::with_capacity(usize::try_from(metadata.len()).unwrap_or(0));
        // A file that grows while it is read stays within the limit.
        File::open(path).and_then(|file| file.take(MAX_BYTES).read_to_end(&mut bytes)).map_err(fail)?;
        Ok(Self { name, bytes })
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
