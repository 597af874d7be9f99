//! The synthetic volumes, read as plainly as their header allows: dimensions, then bytes.

use std::fs;
use std::path::{Path, PathBuf};

use farfield::medium::{Medium, MediumShape, Voxel};
use formats::sggx::{FlakeLobe, Sggx};

/// Edge of a voxel, metres; the files say none.
pub(crate) const VOXEL: f64 = 1e-5;

/// A synthetic scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scene {
    /// Its name.
    pub(crate) name: &'static str,
    /// Flake area per volume of a full voxel, times the voxel's edge: `density_max_per_voxel_edge` of `volumes.json`.
    density: f32,
    /// Axes without ends.
    repeat: [bool; 3],
}

/// The five scenes.
pub(crate) const SCENES: [Scene; 5] = [
    Scene { name: "twill", density: 1.8, repeat: [true, true, false] },
    Scene { name: "velvet", density: 1.5, repeat: [true, true, false] },
    Scene { name: "ball", density: 1.6, repeat: [false; 3] },
    Scene { name: "bundle", density: 1.5, repeat: [false; 3] },
    Scene { name: "mixed", density: 1.5, repeat: [false; 3] },
];

/// The folder of the scenes: `FARFIELD_VOLUMES`, or that beside the project; `None`, with a word about it, where there is
/// none.
pub(crate) fn folder() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/synthetic/volumes");
    let folder = std::env::var_os("FARFIELD_VOLUMES").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no synthetic volumes in {}; set FARFIELD_VOLUMES", folder.display());
    None
}

impl Scene {
    /// The scene as a medium of one lobe a voxel.
    pub(crate) fn medium(&self, folder: &Path) -> Medium {
        let grid = |what: &str| Grid::read(&folder.join(format!("{}.{what}.vol", self.name)));
        let [density, albedo, fibre, along] = ["density", "albedo", "fibre", "along"].map(grid);
        let shape = MediumShape { size: density.size, voxel: [VOXEL; 3], repeat: self.repeat };
        Medium::new(shape, 1, |at| {
            let rho = density.at(at)[0] * self.density / VOXEL as f32;
            if rho == 0.0 {
                return None;
            }
            let [r, g, b] = [0, 1, 2].map(|c| albedo.at(at)[c]);
            let lobe =
                FlakeLobe { area: 1.0, shape: fibre_lobe(fibre.bytes_at(at), along.at(at)[0]), albedo: [r, g, b] };
            Some(Voxel::new(rho, &[lobe]))
        })
    }
}

/// A lobe from a direction in encoding 4 (θ·255/π, φ·255/2π) and the smallest eigenvalue of S.
fn fibre_lobe(code: &[u8], along: f32) -> Sggx {
    let [theta, phi] =
        [f32::from(code[0]) / 255.0 * std::f32::consts::PI, f32::from(code[1]) / 255.0 * std::f32::consts::TAU];
    let axis = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
    Sggx::fibre(axis, along.max(1e-4).sqrt())
}

/// A grid of bytes, x fastest.
struct Grid {
    size: [usize; 3],
    channels: usize,
    bytes: Vec<u8>,
}

/// Bytes of a header: magic, version, encoding, three sizes, channels, a box.
const HEADER: usize = 48;

impl Grid {
    fn read(file: &Path) -> Self {
        let bytes = fs::read(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        assert_eq!(&bytes[..4], b"VOL\x03", "{}", file.display());
        let int = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        let [encoding, channels] = [int(4), int(20)];
        assert!(encoding == 3 || encoding == 4, "bytes or directions: {}", file.display());
        let size = [int(8), int(12), int(16)];
        assert_eq!(bytes.len(), HEADER + size[0] * size[1] * size[2] * channels, "{}", file.display());
        Self { size, channels, bytes: bytes[HEADER..].to_vec() }
    }

    fn bytes_at(&self, [x, y, z]: [usize; 3]) -> &[u8] {
        &self.bytes[((z * self.size[1] + y) * self.size[0] + x) * self.channels..][..self.channels]
    }

    fn at(&self, at: [usize; 3]) -> [f32; 3] {
        let bytes = self.bytes_at(at);
        std::array::from_fn(|c| bytes.get(c).map_or(0.0, |&byte| f32::from(byte) / 255.0))
    }
}
