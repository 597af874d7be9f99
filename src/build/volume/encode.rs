//! Between media and assets: the only place where voxels of the compiler become those of `formats`, and back.

use std::collections::BTreeMap;

use formats::sggx::Sggx;
use formats::volume::{VolumeAsset, VolumeLevel, VolumeSource};
use serde_json::json;

use super::super::manifest::{AlbedoSpec, AlongSpec, SggxSpec, VolumeSpec};
use super::VolumeInput;
use crate::medium::{Medium, MediumShape, Voxel};

/// Raised when the compiler writes other bytes for the same input and settings.
pub const VOLUME_VERSION: u32 = 1;

impl VolumeInput {
    /// The volume as a medium: one lobe a voxel.
    pub fn medium(&self) -> Medium {
        let shape = MediumShape { size: self.size, voxel: self.voxel, repeat: self.repeat };
        Medium::new(shape, 1, |[x, y, z]| {
            let index = (z * self.size[1] + y) * self.size[0] + x;
            let density = self.density[index];
            let lobe = |shape| formats::FlakeLobe { area: 1.0, shape, albedo: self.albedo.at(index) };
            // Occupied voxels were checked: the isotropic one stands for none of them.
            let shape = || Sggx::from_matrix(self.shapes[index]).unwrap_or(Sggx::ISOTROPIC);
            (density > 0.0).then(|| Voxel::new(density, &[lobe(shape())]))
        })
    }
}

/// The asset of `spec` with the given levels: no time, path, thread count or host is in it.
pub fn volume_asset(spec: &VolumeSpec, input: &VolumeInput, levels: Vec<VolumeLevel>) -> VolumeAsset {
    VolumeAsset {
        name: spec.name.clone(),
        voxel: spec.voxel,
        repeat: spec.repeat,
        source: VolumeSource { digest: input.density_digest.clone(), size: input.size.map(|n| n as u32) },
        settings: settings(spec, input),
        versions: BTreeMap::from([("volume".into(), VOLUME_VERSION.to_string())]),
        seed: spec.seed,
        isa: "baseline".into(),
        levels,
    }
}

/// Level number `index` (from 1) of a source of `source` voxels as the asset holds it, its error not yet known.
pub fn volume_level(index: u32, source: [usize; 3], medium: &Medium) -> VolumeLevel {
    let size = medium.shape().size;
    let voxels = (0..size.iter().product::<usize>()).filter_map(|at| {
        let place = [at % size[0], at / size[0] % size[1], at / size[0] / size[1]];
        medium.voxel_index(place).map(|voxel| (at as u32, voxel))
    });
    let (occupied, voxels): (Vec<u32>, Vec<usize>) = voxels.unzip();
    let voxels: Vec<Voxel> = voxels.into_iter().map(|voxel| medium.voxel(voxel)).collect();
    VolumeLevel {
        index,
        factor: std::array::from_fn(|axis| source[axis] as f64 / size[axis] as f64),
        size,
        occupied,
        density: voxels.iter().map(|voxel| voxel.density).collect(),
        lobes: (0..medium.lobe_count()).map(|j| voxels.iter().map(|voxel| voxel.lobes()[j]).collect()).collect(),
        error: BTreeMap::new(),
        fit: serde_json::Value::Null,
        limited_by: None,
    }
}

/// A level of `asset` as a medium.
pub fn medium_of(asset: &VolumeAsset, level: &VolumeLevel) -> Medium {
    let voxel = std::array::from_fn(|axis| asset.voxel[axis] * level.factor[axis]);
    let shape = MediumShape { size: level.size, voxel, repeat: asset.repeat };
    Medium::new(shape, level.lobes.len(), |[x, y, z]| {
        let index = (z * level.size[1] + y) * level.size[0] + x;
        let voxel = level.voxel(level.occupied.binary_search(&(index as u32)).ok()?);
        Some(Voxel::new(voxel.density, &voxel.lobes))
    })
}

/// The settings that the bytes depend on, in one form whatever the manifest looked like.
fn settings(spec: &VolumeSpec, input: &VolumeInput) -> serde_json::Value {
    let along = |along: &AlongSpec| match along {
        AlongSpec::Constant(along) => json!(along),
        AlongSpec::Areas(_) | AlongSpec::Eigenvalues(_) => json!("grid"),
    };
    let (orientation, along) = match &spec.sggx {
        SggxSpec::Matrices(_) => (json!("matrices"), json!(null)),
        SggxSpec::Fibres { along: a, .. } => (json!("fibres"), along(a)),
        SggxSpec::StructureTensor { settings, along: a } => {
            (json!({ "sigma": settings.sigma, "rho": settings.rho }), along(a))
        }
    };
    let albedo = match &spec.albedo {
        // As the manifest has them, not as the nearest single's digits in double.
        AlbedoSpec::Constant(rgb) => json!(rgb.map(|a| a.to_string().parse::<f64>().unwrap_or(f64::from(a)))),
        AlbedoSpec::Grid(_) => json!("grid"),
    };
    json!({
        "albedo": albedo,
        "along": along,
        "clusters": spec.clusters,
        "digests": input.digests,
        "error": spec.error,
        "levels": spec.levels,
        "lobes": spec.lobes,
        "optimizer": spec.optimizer.name(),
        "orientation": orientation,
        "scale": spec.density.scale,
        "window": spec.density.window,
    })
}
