//! A volume asset as the bytes of its files.

use super::bricks::Bricks;
use super::document::{Document, LevelDocument, Role};
use super::packing::{self, AlbedoRange, Packed, UNUSED, albedo_codes, albedo_range};
use super::{MAX_STORED_DENSITY, MAX_VOLUME_LOBES, VolumeAsset, VolumeLevel};
use crate::asset::DOCUMENT;
use crate::asset::document::{FileDocument, MAX_DOCUMENT_LENGTH};
use crate::ktx2::Texels;
use crate::{Error, ktx2};
use half::f16;
use std::collections::BTreeMap;

impl VolumeAsset {
    /// The bytes of every file by name, `asset.json` included; the same bytes for the same asset.
    ///
    /// As for surfaces: names carry contents, `asset.json` is replaced last, and what the format cannot hold is an error that
    /// names level and voxel. Voxels of less than 1e-12 of a level's largest density are stored as empty.
    pub fn encode(&self) -> Result<BTreeMap<String, Vec<u8>>, Error> {
        let mut files = BTreeMap::new();
        let levels = self.levels.iter().map(|level| encode_level(level, &mut files)).collect::<Result<_, _>>()?;
        let document = Document::new(self, levels);
        document.check().map_err(|fault| Error::shape(fault.place, fault.wanted, fault.found))?;
        let json = serde_json::to_vec_pretty(&document).expect("a tree with string keys is JSON");
        if json.len() as u64 > MAX_DOCUMENT_LENGTH {
            let wanted = format!("at most {MAX_DOCUMENT_LENGTH} bytes of `{DOCUMENT}`");
            return Err(Error::shape("settings, versions and levels", wanted, format!("{} bytes", json.len())));
        }
        files.insert(DOCUMENT.into(), json);
        Ok(files)
    }
}

/// A level's voxels as codes, in the order of `occupied`; those whose density rounds to 0 are left out.
struct Codes {
    occupied: Vec<u32>,
    density: Vec<f16>,
    /// `[lobe][voxel]`.
    shapes: Vec<Vec<[u8; 6]>>,
    albedos: Vec<Vec<[f32; 3]>>,
    /// 1/m of the stored density 1.
    unit: f32,
}

fn encode_level(level: &VolumeLevel, files: &mut BTreeMap<String, Vec<u8>>) -> Result<LevelDocument, Error> {
    check_shape(level)?;
    let codes = codes_of(level)?;
    let bricks = Bricks::of(level.size, &codes.occupied);
    let ranges: Vec<AlbedoRange> = (0..level.lobes.len()).map(|lobe| range_of(&codes, lobe)).collect();
    let mut document = LevelDocument {
        index: level.index,
        factor: level.factor,
        size: level.size,
        occupied: codes.occupied.len(),
        bricks: bricks.count,
        atlas: bricks.atlas,
        density: codes.unit,
        albedo: ranges,
        lobes: level.lobes.len(),
        files: Vec::new(),
        error: level.error.clone(),
        fit: level.fit.clone(),
        limited_by: level.limited_by.clone(),
    };
    let mut put = |document: &mut LevelDocument, role: Role, texels: &Texels| {
        let bytes = ktx2::write(texels, role.size(document));
        let digest = blake3::hash(&bytes).to_hex();
        let path = format!("level{}.{}.{}.ktx2", level.index, role.name(), &digest[..16]);
        document.files.push(FileDocument { role: role.name(), path: path.clone(), digest: digest.to_string() });
        files.insert(path, bytes);
    };
    let texels = bricks.atlas_size().iter().product();
    put(&mut document, Role::Bricks, &Texels::Index(bricks.index.clone()));
    let mut density = vec![f16::ZERO; texels];
    for (&voxel, &value) in codes.occupied.iter().zip(&codes.density) {
        density[bricks.texel_of(voxel as usize).expect("its brick is stored")] = value;
    }
    put(&mut document, Role::Density, &Texels::HalfSingle(density));
    for lobe in 0..level.lobes.len() {
        let [shape, albedo, shear] = lobe_texels(&codes, lobe, &document.albedo[lobe], &bricks);
        put(&mut document, Role::Shape(lobe), &shape);
        put(&mut document, Role::Albedo(lobe), &albedo);
        put(&mut document, Role::Shear(lobe), &shear);
    }
    Ok(document)
}

/// Every array of the level has as many values as the level's counts say, and its indices rise.
fn check_shape(level: &VolumeLevel) -> Result<(), Error> {
    let voxels = level.size.iter().fold(1usize, |product, &n| product.saturating_mul(n));
    let place = |what: &str| format!("level {}, {what}", level.index);
    if voxels > u32::MAX as usize {
        return Err(Error::shape(place("product of `size`"), format!("at most {}", u32::MAX), voxels));
    }
    if !(1..=MAX_VOLUME_LOBES).contains(&level.lobes.len()) {
        return Err(Error::shape(place("`lobes`"), format!("1 to {MAX_VOLUME_LOBES}"), level.lobes.len()));
    }
    let lists = level.lobes.iter().map(Vec::len).enumerate().map(|(lobe, found)| (format!("lobe {lobe}"), found));
    for (role, found) in lists.chain([("density".to_string(), level.density.len())]) {
        if found != level.occupied.len() {
            let [wanted, found] = [level.occupied.len(), found].map(|count| format!("{count} values"));
            return Err(Error::shape(place(&role), wanted, found));
        }
    }
    let rising = level.occupied.windows(2).position(|pair| pair[0] >= pair[1]).map(|index| index + 1);
    let beyond = level.occupied.last().filter(|&&last| last as usize >= voxels).map(|_| level.occupied.len() - 1);
    match rising.or(beyond) {
        None => Ok(()),
        Some(index) => Err(Error::Value {
            role: place("occupied"),
            index,
            wanted: format!("rising indices less than {voxels}"),
            found: level.occupied[index].to_string(),
        }),
    }
}

/// The codes of all voxels of a level.
fn codes_of(level: &VolumeLevel) -> Result<Codes, Error> {
    let packed: Vec<Packed> = (0..level.occupied.len()).map(|voxel| pack(level, voxel)).collect::<Result<_, _>>()?;
    let densest = packed.iter().map(|packed| packed.density).fold(0.0, f64::max);
    let unit = if densest > 0.0 { (densest / f64::from(MAX_STORED_DENSITY)) as f32 } else { 1.0 };
    let densities: Vec<f16> = packed.iter().map(|packed| f16::from_f64(packed.density / f64::from(unit))).collect();
    let kept: Vec<usize> = (0..packed.len()).filter(|&voxel| densities[voxel] > f16::ZERO).collect();
    let lobes = 0..level.lobes.len();
    Ok(Codes {
        occupied: kept.iter().map(|&voxel| level.occupied[voxel]).collect(),
        density: kept.iter().map(|&voxel| densities[voxel].min(f16::from_f32(MAX_STORED_DENSITY))).collect(),
        shapes: lobes.clone().map(|lobe| kept.iter().map(|&voxel| packed[voxel].codes[lobe]).collect()).collect(),
        albedos: lobes.map(|lobe| kept.iter().map(|&voxel| level.lobes[lobe][voxel].albedo).collect()).collect(),
        unit,
    })
}

/// The codes of one voxel, if the format can hold it.
fn pack(level: &VolumeLevel, voxel: usize) -> Result<Packed, Error> {
    /// Sum of area fractions that may be meant as 1.
    const ABOUT_ONE: std::ops::RangeInclusive<f32> = 0.999..=1.001;
    let fail = |what: &str, wanted: &str, found: String| Error::Value {
        role: format!("level {}, {what}", level.index),
        index: voxel,
        wanted: wanted.into(),
        found,
    };
    let density = level.density[voxel];
    if !(density > 0.0 && density.is_finite()) {
        return Err(fail("density", "a finite density greater than 0 in 1/m", format!("{density:?}")));
    }
    for (number, lobes) in level.lobes.iter().enumerate() {
        let lobe = &lobes[voxel];
        if !(0.0..=1.0).contains(&lobe.area) {
            return Err(fail(&format!("lobe {number}"), "an area fraction in [0, 1]", format!("{:?}", lobe.area)));
        }
        if !lobe.albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
            return Err(fail(&format!("lobe {number}"), "an albedo in [0, 1]", format!("{:?}", lobe.albedo)));
        }
    }
    let lobes = || level.lobes.iter().map(|lobe| lobe[voxel]);
    let areas: f32 = lobes().map(|lobe| lobe.area).sum();
    if !ABOUT_ONE.contains(&areas) {
        return Err(fail("lobes", "area fractions that sum to 1", format!("{areas:?}")));
    }
    packing::pack(density, lobes()).ok_or_else(|| fail("lobes", "flakes of finite area", "none".into()))
}

/// Range of the albedo of a lobe over the voxels that use it.
fn range_of(codes: &Codes, lobe: usize) -> AlbedoRange {
    let used = codes.albedos[lobe].iter().zip(&codes.shapes[lobe]).filter(|(_, shape)| **shape != UNUSED);
    albedo_range(used.map(|(rgb, _)| *rgb))
}

/// The three textures of a lobe, as [`Role`] says.
fn lobe_texels(codes: &Codes, lobe: usize, range: &AlbedoRange, bricks: &Bricks) -> [Texels; 3] {
    let texels = bricks.atlas_size().iter().product();
    let mut shape = vec![[0, 0, 0, UNUSED[3]]; texels];
    let mut albedo = vec![[0, 0, 0, UNUSED[4]]; texels];
    let mut shear = vec![UNUSED[5]; texels];
    let (mut carry, mut brick) = ([0.0; 3], 0);
    for stored in bricks.voxels() {
        if stored.brick != brick {
            (carry, brick) = ([0.0; 3], stored.brick);
        }
        let Ok(place) = codes.occupied.binary_search(&(stored.voxel as u32)) else { continue };
        let m = codes.shapes[lobe][place];
        if m == UNUSED {
            continue;
        }
        let [r, g, b] = albedo_codes(codes.albedos[lobe][place], range, &mut carry);
        shape[stored.texel] = [m[0], m[1], m[2], m[3]];
        albedo[stored.texel] = [r, g, b, m[4]];
        shear[stored.texel] = m[5];
    }
    [Texels::Bytes(shape), Texels::Bytes(albedo), Texels::Byte(shear)]
}
