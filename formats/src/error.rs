//! What can be wrong with an asset: one line that says where, what was wanted, what was found.

use std::fmt;
use std::path::PathBuf;

/// Why an asset could not be written or read.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The file system refused.
    Io {
        /// File or folder that was opened or read.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file does not hold what its place in the asset asks for.
    Malformed {
        /// File, as `asset.json` names it.
        path: String,
        /// Place in the file, in words.
        place: String,
        /// What the format asks for there.
        wanted: String,
        /// What is there.
        found: String,
    },
    /// A file's bytes are not those that were published.
    Digest {
        /// File, as `asset.json` names it.
        path: String,
        /// BLAKE3 in `asset.json`, 64 hex digits.
        wanted: String,
        /// BLAKE3 of the bytes found.
        found: String,
    },
    /// A value that the format cannot hold, met while encoding.
    Value {
        /// Role of the table, such as `level 1, lobe0`.
        role: String,
        /// Index of the value in its table.
        index: usize,
        /// What the format can hold.
        wanted: String,
        /// The value.
        found: String,
    },
    /// Two parts of an asset that do not fit together, met while encoding.
    Shape {
        /// Part of the asset, in words.
        role: String,
        /// Count or range that the rest of the asset asks for.
        wanted: String,
        /// What it has.
        found: String,
    },
}

impl Error {
    /// A file that is not what the format asks for at `place`.
    pub(crate) fn malformed(
        path: &str,
        place: impl Into<String>,
        wanted: impl fmt::Display,
        found: impl fmt::Display,
    ) -> Self {
        Self::Malformed { path: path.into(), place: place.into(), wanted: wanted.to_string(), found: found.to_string() }
    }

    /// A part of an asset that does not fit the rest.
    pub(crate) fn shape(role: impl Into<String>, wanted: impl fmt::Display, found: impl fmt::Display) -> Self {
        Self::Shape { role: role.into(), wanted: wanted.to_string(), found: found.to_string() }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io { path, source } => write!(f, "`{}`: reading failed: {source}", path.display()),
            Self::Malformed { path, place, wanted, found } => {
                write!(f, "`{path}`: {place}: wanted {wanted}, found {found}")
            }
            Self::Digest { path, wanted, found } => {
                write!(f, "`{path}`: the file was changed after it was written: wanted BLAKE3 {wanted}, found {found}")
            }
            Self::Value { role, index, wanted, found } => write!(f, "{role}[{index}]: wanted {wanted}, found {found}"),
            Self::Shape { role, wanted, found } => write!(f, "{role}: wanted {wanted}, found {found}"),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}
