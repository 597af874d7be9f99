//! The keys of a `[volume.NAME]`.

mod grid;

pub use grid::GridSpec;

use super::fields::{Fields, numbers};
use super::{ERROR_WANTED, is_error};
use crate::prefilter::volume::orientation::OrientationSettings;
use grid::{GRID, read_grid, read_grid_with};

/// A volume to build, as its manifest describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeSpec {
    /// Its name, safe as a folder.
    pub name: String,
    /// Flake area per volume.
    pub density: DensitySpec,
    /// Albedo of the flakes.
    pub albedo: AlbedoSpec,
    /// Shapes of the flakes' normals.
    pub sggx: SggxSpec,
    /// Metres along x, y and z of a voxel.
    pub voxel: [f64; 3],
    /// Axes along which the volume repeats without end.
    pub repeat: [bool; 3],
    /// Downsampling factors, finest first.
    pub levels: Vec<usize>,
    /// Lobes of a voxel; `None` lets the compiler choose.
    pub lobes: Option<usize>,
    /// Clusters of voxels that share their weights; `None` lets the compiler choose.
    pub clusters: Option<usize>,
    /// How the lobes' weights are found.
    pub optimizer: Optimizer,
    /// Relative error of image means that is aimed at.
    pub error: f64,
    /// Seed of everything random.
    pub seed: u64,
}

impl VolumeSpec {
    /// The grids that the volume is read from, each under the manifest's key for it.
    pub fn grids(&self) -> Vec<(&'static str, &GridSpec)> {
        let mut grids = vec![("density", &self.density.grid)];
        match &self.albedo {
            AlbedoSpec::Constant(_) => {}
            AlbedoSpec::Grid(grid) => grids.push(("albedo", grid)),
        }
        let along = match &self.sggx {
            SggxSpec::Matrices(grid) => {
                grids.push(("sggx", grid));
                None
            }
            SggxSpec::Fibres { directions, along } => {
                grids.push(("fibre", directions));
                Some(along)
            }
            SggxSpec::StructureTensor { settings: _, along } => Some(along),
        };
        match along {
            None | Some(AlongSpec::Constant(_)) => {}
            Some(AlongSpec::Areas(grid)) => grids.push(("along", grid)),
            Some(AlongSpec::Eigenvalues(grid)) => grids.push(("eigenvalue", grid)),
        }
        grids
    }
}

/// Where the density comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct DensitySpec {
    /// The grid, one number a voxel.
    pub grid: GridSpec,
    /// Stored codes that become 0 and 1, clamped beyond; `None` takes codes as fractions of the largest, floats as stored.
    pub window: Option<[f64; 2]>,
    /// 1/m of the value 1.
    pub scale: f64,
}

/// Where the albedo comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum AlbedoSpec {
    /// Linear RGB, the same everywhere.
    Constant([f32; 3]),
    /// A grid of three numbers a voxel, or of one.
    Grid(GridSpec),
}

/// Where the matrices S come from.
#[derive(Clone, Debug, PartialEq)]
pub enum SggxSpec {
    /// A grid of six numbers, xx yy zz xy xz yz, or of all nine.
    Matrices(GridSpec),
    /// Fibres along a grid of directions.
    Fibres {
        /// Three numbers a voxel.
        directions: GridSpec,
        /// What the fibres show lengthwise.
        along: AlongSpec,
    },
    /// Fibres along which the density's grid changes least.
    StructureTensor {
        /// Scales of the tensor.
        settings: OrientationSettings,
        /// What the fibres show lengthwise.
        along: AlongSpec,
    },
}

/// The area that a fibre's flakes show lengthwise, of 1 crosswise.
#[derive(Clone, Debug, PartialEq)]
pub enum AlongSpec {
    /// σ along the fibre, the same everywhere.
    Constant(f64),
    /// A grid of σ along the fibre.
    Areas(GridSpec),
    /// A grid of its square, the smallest eigenvalue of S.
    Eigenvalues(GridSpec),
}

/// How the weights of a level's lobes are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Optimizer {
    /// Recorded paths reweighted, Levenberg–Marquardt.
    LevenbergMarquardt,
    /// Stochastic gradient descent with path-traced gradients.
    GradientDescent,
    /// None: weights follow from averages alone.
    Naive,
}

impl Optimizer {
    const ALL: [Self; 3] = [Self::LevenbergMarquardt, Self::GradientDescent, Self::Naive];

    /// Its name in the manifest.
    pub fn name(self) -> &'static str {
        match self {
            Self::LevenbergMarquardt => "lm",
            Self::GradientDescent => "sgd",
            Self::Naive => "none",
        }
    }
}

/// The largest factor: nothing is left of the largest volume.
const MAX_FACTOR: u64 = 1024;

/// Most levels of an asset.
const MAX_LEVELS: usize = formats::asset::MAX_LEVELS;

/// Most lobes of a voxel: those that a medium holds.
const MAX_LOBES: u64 = crate::medium::MAX_LOBES as u64;

/// Most clusters: each has weights of its own to be found.
const MAX_CLUSTERS: u64 = 64;

/// Scales of the structure tensor where the manifest names none: those that suit fibres a few voxels wide.
const DEFAULT_SCALES: [f64; 2] = [1.0, 4.0];

/// Reads the volume `name`; `None` where something is missing or wrong, which is then noted.
pub(super) fn read(name: &str, mut fields: Fields<'_, '_, '_, '_>, default_error: f64) -> Option<VolumeSpec> {
    const LEVELS: &str = "increasing whole downsampling factors from 1 to 1024, as in `[2, 4]`";
    const VOXEL: &str = "the metres of a voxel's edge, as in `1e-5`, or of its three";
    const ALBEDO: &str = "three numbers from 0 to 1 (linear RGB), or the grid of them";
    const SGGX: &str = "a table with `from`, `fibre` or `file`, as in `{ fibre = \"direction.vol\", along = 0.1 }`";
    fields.require("density", GRID);
    fields.require("albedo", ALBEDO);
    fields.require("sggx", SGGX);
    fields.require("voxel", VOXEL);
    fields.require("levels", LEVELS);

    let density = read_density(&mut fields);
    let albedo = match fields.raw("albedo").is_some_and(|(_, value)| value.get_ref().is_array()) {
        true => {
            let rgb = fields.numbers::<3>("albedo", ALBEDO, |n| (0.0..=1.0).contains(&n));
            rgb.map(|rgb| AlbedoSpec::Constant(rgb.map(|n| n as f32)))
        }
        false => read_grid(&mut fields, "albedo", ALBEDO).map(AlbedoSpec::Grid),
    };
    let sggx = fields.table("sggx", read_sggx).flatten();
    let voxel = fields.value("voxel", VOXEL, |value| {
        let edges = numbers(value).or_else(|| super::fields::number(value).map(|edge| vec![edge; 3]))?;
        <[f64; 3]>::try_from(edges).ok().filter(|edges| edges.iter().all(|edge| (1e-10..=1e9).contains(edge)))
    });
    let repeat = fields.value("repeat", "three times `true` or `false`, of x, y and z", |value| {
        let flags: Option<Vec<bool>> = value.as_array()?.iter().map(|flag| flag.get_ref().as_bool()).collect();
        flags?.try_into().ok()
    });
    let levels = read_levels(&mut fields, LEVELS);
    let lobes = read_count(&mut fields, "lobes", MAX_LOBES);
    let clusters = read_count(&mut fields, "clusters", MAX_CLUSTERS);
    let names = "`\"lm\"`, `\"sgd\"` or `\"none\"`";
    let optimizer =
        fields.value("optimizer", names, |value| named(value.as_str()?, &Optimizer::ALL.map(|one| (one.name(), one))));
    let error = fields.number("error", ERROR_WANTED, is_error).unwrap_or(default_error);
    let seed = fields.integer("seed", [0, i64::MAX as u64]).unwrap_or(0);
    fields.finish();
    Some(VolumeSpec {
        name: name.into(),
        density: density?,
        albedo: albedo?,
        sggx: sggx?,
        voxel: voxel?,
        repeat: repeat.unwrap_or([false; 3]),
        levels: levels?,
        lobes,
        clusters,
        optimizer: optimizer.unwrap_or(Optimizer::LevenbergMarquardt),
        error,
        seed,
    })
}

/// What `name` stands for.
fn named<T: Copy>(name: &str, names: &[(&str, T)]) -> Option<T> {
    names.iter().find(|(known, _)| *known == name).map(|(_, meaning)| *meaning)
}

/// The grid of densities, with its window and scale where it is a table.
fn read_density(fields: &mut Fields<'_, '_, '_, '_>) -> Option<DensitySpec> {
    const WINDOW: &str = "two different stored values, as in `[90, 160]`: those of density 0 and of `scale`";
    const SCALE: &str = "1/m of the value 1, greater than 0 and at most 1e12";
    // What a plain path has.
    let (mut window, mut scale) = (Some(None), Some(1.0));
    let grid = read_grid_with(fields, "density", GRID, &mut |table| {
        if table.raw("window").is_some() {
            let ends = table.numbers::<2>("window", WINDOW, |n| n.abs() <= 1e30);
            let differ = |[low, high]: &[f64; 2]| low != high;
            if ends.is_some_and(|ends| !differ(&ends)) {
                table.mistake("window", format!("`window` has no width; wanted {WINDOW}"));
            }
            window = ends.filter(differ).map(Some);
        }
        if table.raw("scale").is_some() {
            scale = table.number("scale", SCALE, |n| n > 0.0 && n <= 1e12);
        }
    });
    Some(DensitySpec { grid: grid?, window: window?, scale: scale? })
}

/// One of the three forms of `sggx`.
fn read_sggx(fields: &mut Fields<'_, '_, '_, '_>) -> Option<SggxSpec> {
    let forms = ["from", "fibre", "file"].map(|key| fields.has(key));
    match forms {
        [true, false, false] => {
            let wanted = "`\"structure-tensor\"`";
            fields
                .value("from", wanted, |value| value.as_str().filter(|text| *text == "structure-tensor").map(|_| ()))?;
            let scale = |fields: &mut Fields<'_, '_, '_, '_>, key, default| match fields.raw(key) {
                Some(_) => fields.number(key, "voxels, from 0 to 32", |n| (0.0..=32.0).contains(&n)),
                None => Some(default),
            };
            let [sigma, rho] = [scale(fields, "sigma", DEFAULT_SCALES[0]), scale(fields, "rho", DEFAULT_SCALES[1])];
            let along = read_along(fields);
            let settings = OrientationSettings { sigma: sigma? as f32, rho: rho? as f32 };
            Some(SggxSpec::StructureTensor { settings, along: along? })
        }
        [false, true, false] => {
            let directions = read_grid(fields, "fibre", "the grid of the fibres' directions");
            let along = read_along(fields);
            Some(SggxSpec::Fibres { directions: directions?, along: along? })
        }
        [false, false, true] => grid::read_keys(fields, "file").map(SggxSpec::Matrices),
        _ => {
            fields.excuse_keys();
            let found = if forms.contains(&true) { "more than one" } else { "none" };
            fields.mistake_here(|title| format!("`{title}` has {found} of `from`, `fibre` and `file`; wanted one"));
            None
        }
    }
}

/// `along` or `eigenvalue`.
fn read_along(fields: &mut Fields<'_, '_, '_, '_>) -> Option<AlongSpec> {
    const ALONG: &str = "the area that a fibre shows lengthwise, from 0.01 to 1, or the grid of it";
    let [along, eigenvalue] = ["along", "eigenvalue"].map(|key| fields.has(key));
    if along && eigenvalue {
        let _ = fields.raw("along");
        fields.refuse("eigenvalue", "`eigenvalue` is the square of `along`; wanted one of them");
        return None;
    }
    if eigenvalue {
        let _ = fields.raw("along");
        let wanted = "the grid of the smallest eigenvalues of S";
        return read_grid(fields, "eigenvalue", wanted).map(AlongSpec::Eigenvalues);
    }
    fields.require("along", ALONG);
    let _ = fields.raw("eigenvalue");
    let (_, value) = fields.raw("along")?;
    if super::fields::number(value.get_ref()).is_none() && (value.get_ref().is_str() || value.get_ref().is_table()) {
        return read_grid(fields, "along", ALONG).map(AlongSpec::Areas);
    }
    fields.number("along", ALONG, |n| (0.01..=1.0).contains(&n)).map(AlongSpec::Constant)
}

/// The factors of `levels`.
fn read_levels(fields: &mut Fields<'_, '_, '_, '_>, wanted: &str) -> Option<Vec<usize>> {
    let (_, value) = fields.raw("levels")?;
    if value.get_ref().as_str() == Some("auto") {
        let message = format!("`levels` `\"auto\"` is not supported in this version; wanted {wanted}");
        fields.mistake("levels", message);
        return None;
    }
    fields.value("levels", wanted, |value| {
        let factors: Option<Vec<u64>> =
            value.as_array()?.iter().map(|factor| super::fields::integer(factor.get_ref())).collect();
        let factors = factors?;
        let admissible = factors.iter().all(|factor| (1..=MAX_FACTOR).contains(factor));
        let increasing = factors.windows(2).all(|pair| pair[0] < pair[1]);
        let counted = (1..=MAX_LEVELS).contains(&factors.len());
        (counted && admissible && increasing).then(|| factors.into_iter().map(|factor| factor as usize).collect())
    })
}

/// `"auto"`, which is `None`, or a count from 1.
fn read_count(fields: &mut Fields<'_, '_, '_, '_>, key: &'static str, most: u64) -> Option<usize> {
    let wanted = format!("`\"auto\"` or an integer from 1 to {most}");
    let count = fields.value(key, &wanted, |value| match value.as_str() {
        Some("auto") => Some(None),
        Some(_) => None,
        None => super::fields::integer(value).filter(|n| (1..=most).contains(n)).map(|n| Some(n as usize)),
    });
    count.flatten()
}

#[cfg(test)]
mod tests;
