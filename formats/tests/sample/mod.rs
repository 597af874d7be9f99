//! Surface assets made of random numbers: every feature of the format, few bytes.
#![allow(dead_code, reason = "each test and example uses its part")]

use farfield_formats::asset::{AdditiveTerm, Figure, LevelError, Light, Source, SurfaceLevel};
use farfield_formats::lookup::direction_of;
use farfield_formats::{BaseBrdf, Boundary, Lobe, Specular, SurfaceAsset};
use std::collections::BTreeMap;

/// SplitMix64: uniform numbers from a seed.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u32 << 24) as f32
    }

    /// Uniform in [low, high).
    pub(crate) fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform over the upper hemisphere.
    pub(crate) fn direction(&mut self) -> [f32; 3] {
        direction_of([self.unit(), self.unit()])
    }

    fn rgb(&mut self, low: f32, high: f32) -> [f32; 3] {
        [0; 3].map(|_| self.within(low, high))
    }
}

/// What a sample asset has.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) boundary: Boundary,
    pub(crate) has_color: bool,
    pub(crate) is_specular: bool,
    pub(crate) cells: [usize; 2],
    pub(crate) lobes: usize,
    pub(crate) patches: [usize; 2],
    pub(crate) directions: usize,
    pub(crate) rank: usize,
    /// Direction cells of the additive term, if it has one.
    pub(crate) additive: Option<usize>,
    pub(crate) seed: u64,
}

impl Sample {
    /// Small enough to be taken apart byte by byte.
    pub(crate) const SMALL: Self = Self {
        boundary: Boundary::Repeat,
        has_color: true,
        is_specular: true,
        cells: [3, 2],
        lobes: 2,
        patches: [2, 1],
        directions: 2,
        rank: 2,
        additive: None,
        seed: 7,
    };

    /// Large enough that interpolation meets every kind of border.
    pub(crate) const ROOMY: Self = Self { cells: [17, 9], lobes: 6, patches: [4, 3], directions: 7, ..Self::SMALL };

    pub(crate) fn asset(self) -> SurfaceAsset {
        let mut random = Random(self.seed);
        let figure = Figure { value: 0.012345678901234567, standard_error: 1.5e-4 };
        let specular = self.is_specular.then(|| Specular {
            f0: [0.9, 0.8, 0.7],
            alpha: 0.3,
            gaussians: vec![[44.444_443, 2.1], [11.111_111, 0.9], [2.777_777_7, 0.11], [0.0, 0.004]],
        });
        SurfaceAsset {
            name: "bark".into(),
            light: Light::Direct,
            size: [0.01, 0.03],
            boundary: self.boundary,
            source: Source { digest: "0123456789abcdef".repeat(4), width: 131, height: 77 },
            bsdf: BaseBrdf { diffuse: [0.2, 0.4, 0.6], specular },
            settings: serde_json::json!({ "error": 0.03, "levels": [8] }),
            versions: BTreeMap::from([("lobes".to_string(), "1".to_string()), ("fit".to_string(), "2".to_string())]),
            seed: u64::MAX,
            isa: "baseline".into(),
            levels: vec![SurfaceLevel {
                error: Some(LevelError {
                    below_75: figure,
                    above_75: figure,
                    on_node: figure,
                    bias: Figure { value: -0.001, ..figure },
                    furnace: figure,
                    reciprocity: Figure { value: 0.0, standard_error: 0.0 },
                }),
                ..self.level(&mut random)
            }],
        }
    }

    fn level(self, random: &mut Random) -> SurfaceLevel {
        let cells = self.cells[0] * self.cells[1];
        let patches = self.patches[0] * self.patches[1];
        let pairs = self.directions.pow(4);
        let heights = (0..cells).map(|_| random.within(-4e-4, 4e-4)).collect();
        let lobes = (0..self.lobes).map(|j| (0..cells).map(|_| random_lobe(random, j)).collect()).collect();
        let base_color = self.has_color.then(|| (0..cells).map(|_| random.rgb(0.05, 1.0)).collect());
        // The first term is near 1; later ones correct it in both directions.
        let amounts = |rank| if rank == 0 { [0.5, 1.5] } else { [-0.2, 0.2] };
        let table = |count: usize, random: &mut Random| {
            let one = |rank| (0..count).map(|_| random.rgb(amounts(rank)[0], amounts(rank)[1])).collect();
            (0..self.rank).map(one).collect::<Vec<Vec<_>>>()
        };
        let spatial = table(patches, random);
        let angular = table(pairs, random);
        let additive = self.additive.map(|directions| AdditiveTerm {
            directions,
            spatial: (0..patches).map(|_| random.rgb(0.5, 1.5)).collect(),
            angular: (0..directions.pow(4)).map(|_| random.rgb(0.0, 0.2)).collect(),
        });
        SurfaceLevel {
            index: 1,
            factor: [131.0 / self.cells[0] as f64, 77.0 / self.cells[1] as f64],
            cells: self.cells,
            heights,
            lobes,
            base_color,
            patches: self.patches,
            spatial,
            directions: self.directions,
            angular,
            additive,
            skipped_interreflection: None,
            error: None,
            limited_by: Some("model".into()),
            alternatives: Vec::new(),
        }
    }
}

/// Lobe `j` of a cell: leaning up to about 60°, κ from 0 to 1e6, now and then unused.
fn random_lobe(random: &mut Random, j: usize) -> Lobe {
    if j > 0 && random.unit() < 0.2 {
        return Lobe { mean: [0.0, 0.0, 1.0], kappa: 0.0, weight: 0.0 };
    }
    let mean = direction_of([random.within(0.15, 0.85), random.within(0.15, 0.85)]);
    let kappa = 10f32.powf(random.within(-1.0, 6.0)) - 0.1;
    Lobe { mean, kappa, weight: random.within(0.1, 1.0) / (j + 1) as f32 }
}
