//! What can be wrong with a file, as one line each.

use std::fmt;

/// What was found in a file where something else was wanted.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    System {
        /// The file or folder, as the user named it.
        file: String,
        /// What was tried: `read`, `created`, `renamed`.
        action: &'static str,
        /// The system's answer.
        cause: std::io::Error,
    },
    /// A folder, device or pipe stands where a file was wanted.
    NotAFile {
        /// The path, as the user named it.
        file: String,
        /// `directory` or `special file`.
        found: &'static str,
    },
    /// The file has no bytes.
    Empty {
        /// The file.
        file: String,
        /// The kinds of image that would do.
        wanted: &'static str,
    },
    /// The file has more bytes than any admissible image.
    TooLong {
        /// The file.
        file: String,
        /// Its length.
        bytes: u64,
    },
    /// The first bytes are those of no known image format.
    UnknownFormat {
        /// The file.
        file: String,
        /// The first bytes, printable.
        found: String,
        /// The kinds of image that would do.
        wanted: &'static str,
    },
    /// The header claims more texels than are admissible, or none.
    Size {
        /// The file.
        file: String,
        /// Claimed width.
        width: u64,
        /// Claimed height.
        height: u64,
    },
    /// The header claims more data than a file of this length can hold.
    TooShort {
        /// The file.
        file: String,
        /// Claimed width.
        width: u64,
        /// Claimed height.
        height: u64,
        /// Bytes there.
        found: u64,
        /// The least that such an image takes.
        wanted: u64,
    },
    /// The file breaks the rules of its format, or ends early.
    Damaged {
        /// The file.
        file: String,
        /// `EXR`, `PNG`, `TIFF`, `JPEG`, `HDR`, `VOL`.
        format: &'static str,
        /// What the decoder found.
        found: String,
    },
    /// A valid file of a kind that is not read.
    Unsupported {
        /// The file.
        file: String,
        /// What it holds.
        found: String,
        /// What would do.
        wanted: &'static str,
    },
    /// The wanted channel is not there.
    Channel {
        /// The file.
        file: String,
        /// The channel asked for; `None` where none was and several are there.
        wanted: Option<String>,
        /// Those that exist.
        found: Vec<String>,
    },
    /// A grid of more voxels than are admissible, or of none.
    GridSize {
        /// The file.
        file: String,
        /// Claimed voxels along x, y and z.
        size: [u64; 3],
    },
    /// A grid whose array is shorter or longer than its size says.
    GridLength {
        /// The file.
        file: String,
        /// Claimed voxels along x, y and z.
        size: [usize; 3],
        /// Bytes of a voxel.
        bytes_per_voxel: usize,
        /// Bytes there.
        found: u64,
        /// Bytes of such a grid.
        wanted: u64,
    },
    /// A grid of another kind than its place asks for.
    GridKind {
        /// The file.
        file: String,
        /// What it holds.
        found: String,
        /// What would do.
        wanted: String,
    },
    /// A number of a voxel is NaN or infinite.
    VoxelNotFinite {
        /// The file.
        file: String,
        /// x, y and z, from 0.
        voxel: [usize; 3],
        /// The value.
        value: f32,
    },
    /// A sample is NaN or infinite.
    NotFinite {
        /// The file.
        file: String,
        /// Column and row from the top left, from 0.
        texel: [usize; 2],
        /// The value.
        value: f32,
    },
}

impl Error {
    /// The `Damaged` of `file`, with the decoder's own words on one line.
    pub(super) fn damaged(file: &str, format: &'static str, found: impl fmt::Display) -> Self {
        let found = found.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        Self::Damaged { file: file.into(), format, found }
    }

    /// The `System` of `file`.
    pub(super) fn system(file: &str, action: &'static str, cause: std::io::Error) -> Self {
        Self::System { file: file.into(), action, cause }
    }
}

/// Names in backquotes, separated by commas.
fn list(names: &[String]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System { file, action, cause } => {
                let cause = cause.to_string();
                let cause = cause.split(" (os error").next().unwrap_or_default();
                write!(f, "`{file}`: cannot be {action}: {}", lower_first(cause))
            }
            Self::NotAFile { file, found } => write!(f, "`{file}`: is a {found}; wanted a file"),
            Self::Empty { file, wanted } => write!(f, "`{file}`: is empty (0 bytes); wanted {wanted}"),
            Self::TooLong { file, bytes } => write!(
                f,
                "`{file}`: has {bytes} bytes; wanted at most {} (an image of 16384 × 16384 texels)",
                super::source::MAX_BYTES
            ),
            Self::UnknownFormat { file, found, wanted } => {
                write!(f, "`{file}`: begins with {found}; wanted {wanted}")
            }
            Self::Size { file, width, height } => write!(
                f,
                "`{file}`: the header claims {width} × {height} texels; wanted 1 to {} a side; crop or \
                 downsample the map",
                super::raster::MAX_SIDE
            ),
            Self::TooShort { file, width, height, found, wanted } => write!(
                f,
                "`{file}`: the header claims {width} × {height} texels, which take at least {wanted} bytes; the file \
                 has {found}: it is truncated or its header lies"
            ),
            Self::Damaged { file, format, found } => write!(f, "`{file}`: truncated or damaged {format}: {found}"),
            Self::Unsupported { file, found, wanted } => write!(f, "`{file}`: holds {found}; wanted {wanted}"),
            Self::Channel { file, wanted: Some(wanted), found } => {
                write!(f, "`{file}`: channel `{wanted}` not found; the file has {}", list(found))
            }
            Self::Channel { file, wanted: None, found } => {
                write!(f, "`{file}`: has the channels {}; wanted one of them as `channel`", list(found))
            }
            Self::GridSize { file, size: [x, y, z] } => write!(
                f,
                "`{file}`: has {x} × {y} × {z} voxels; wanted 1 to {} (512³); crop or downsample the volume",
                super::grid::MAX_VOXELS
            ),
            Self::GridLength { file, size: [x, y, z], bytes_per_voxel, found, wanted } => write!(
                f,
                "`{file}`: {x} × {y} × {z} voxels of {bytes_per_voxel} bytes take {wanted} bytes; the file has {found}"
            ),
            Self::GridKind { file, found, wanted } => write!(f, "`{file}`: holds {found}; wanted {wanted}"),
            Self::VoxelNotFinite { file, voxel: [x, y, z], value } => {
                write!(f, "`{file}`: voxel ({x}, {y}, {z}) is {value}; wanted finite values only")
            }
            Self::NotFinite { file, texel: [u, v], value } => {
                write!(f, "`{file}`: texel ({u}, {v}) is {value}; wanted finite values only")
            }
        }
    }
}

impl std::error::Error for Error {}

/// The text with its first letter in lower case, as messages are.
fn lower_first(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map(|first| first.to_lowercase().collect::<String>() + letters.as_str()).unwrap_or_default()
}
