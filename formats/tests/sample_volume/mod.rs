//! Volume assets made of random numbers: every feature of the format, few bytes.
#![allow(dead_code, reason = "each test and example uses its part")]

#[path = "../sample/mod.rs"]
mod sample;

use farfield_formats::asset::Figure;
use farfield_formats::volume::{VolumeAsset, VolumeLevel, VolumeSource};
use farfield_formats::{FlakeLobe, Sggx};
pub(crate) use sample::Random;
use std::collections::BTreeMap;

/// What a sample asset has.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) size: [usize; 3],
    /// Share of voxels that are not empty.
    pub(crate) filled: f32,
    pub(crate) lobes: usize,
    /// Albedo of all flakes, or random ones.
    pub(crate) albedo: Option<[f32; 3]>,
    pub(crate) seed: u64,
}

impl Sample {
    /// Small enough to be taken apart byte by byte.
    pub(crate) const SMALL: Self = Self { size: [5, 4, 3], filled: 0.4, lobes: 2, albedo: None, seed: 7 };

    /// Large enough that some bricks are empty and some are cut by the rim.
    pub(crate) const ROOMY: Self = Self { size: [37, 22, 19], ..Self::SMALL };

    pub(crate) fn asset(self) -> VolumeAsset {
        let mut random = Random(self.seed);
        VolumeAsset {
            name: "cloth".into(),
            voxel: [1e-5, 1e-5, 2e-5],
            repeat: [true, true, false],
            source: VolumeSource { digest: "0123456789abcdef".repeat(4), size: self.size.map(|n| 4 * n as u32 - 1) },
            settings: serde_json::json!({ "levels": [4], "lobes": self.lobes }),
            versions: BTreeMap::from([("volume".to_string(), "1".to_string())]),
            seed: u64::MAX,
            isa: "baseline".into(),
            levels: vec![self.level(&mut random)],
        }
    }

    fn level(self, random: &mut Random) -> VolumeLevel {
        let [nx, ny, nz] = self.size;
        // The far corner is empty in blocks, the rest here and there.
        let far = |voxel: usize| voxel % nx >= 16 && voxel / nx % ny >= 8 && voxel / nx / ny >= 8;
        let occupied: Vec<u32> = (0..nx * ny * nz)
            .filter(|&voxel| !far(voxel) && random.unit() < self.filled)
            .map(|voxel| voxel as u32)
            .collect();
        let density = occupied.iter().map(|_| 10f32.powf(random.within(-1.0, 5.0))).collect();
        let mut lobes = vec![Vec::new(); self.lobes];
        for _ in &occupied {
            let voxel = random_lobes(random, self.lobes, self.albedo);
            lobes.iter_mut().zip(voxel).for_each(|(list, lobe)| list.push(lobe));
        }
        VolumeLevel {
            index: 1,
            factor: [4.0, 4.0, 4.0 - 0.25 / nz as f64],
            size: self.size,
            occupied,
            density,
            lobes,
            error: BTreeMap::from([("bias".to_string(), Figure { value: -0.012, standard_error: 1e-3 })]),
            fit: serde_json::json!({ "objective": 0.5 }),
            limited_by: None,
        }
    }
}

/// The lobes of a voxel: fibres, some of them not used, areas that sum to 1.
fn random_lobes(random: &mut Random, count: usize, albedo: Option<[f32; 3]>) -> Vec<FlakeLobe> {
    let mut lobes: Vec<FlakeLobe> = (0..count)
        .map(|lobe| {
            let is_used = lobe == 0 || random.unit() < 0.8;
            let [x, y, z] = random.direction();
            let axis = if random.unit() < 0.5 { [x, y, z] } else { [x, y, -z] };
            let shape = Sggx::fibre(axis, 10f32.powf(random.within(-1.5, 0.0)));
            let random_albedo = [0; 3].map(|_| random.within(0.1, 1.0));
            FlakeLobe {
                area: if is_used { random.within(0.05, 1.0) } else { 0.0 },
                shape: if is_used { shape } else { Sggx::ISOTROPIC },
                albedo: if is_used { albedo.unwrap_or(random_albedo) } else { [0.0; 3] },
            }
        })
        .collect();
    let sum: f32 = lobes.iter().map(|lobe| lobe.area).sum();
    lobes.iter_mut().for_each(|lobe| lobe.area /= sum);
    lobes
}
