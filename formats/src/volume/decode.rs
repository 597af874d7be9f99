//! A volume asset from the bytes of its files, or from a folder.

use super::bricks::Bricks;
use super::document::{Document, LevelDocument, Role};
use super::packing::{UNUSED, albedo_of, unpack};
use super::{MAX_STORED_DENSITY, PayloadFile, VolumeAsset, VolumeLevel};
use crate::Error;
use crate::asset::DOCUMENT;
use crate::asset::decode::{Fetch, fetch_checked, files_of_roles};
use crate::asset::document::{FileDocument, MAX_DOCUMENT_LENGTH};
use crate::asset::folder::read_bounded;
use crate::ktx2::{self, Texels};
use crate::sggx::FlakeLobe;
use half::f16;
use std::path::Path;

impl VolumeAsset {
    /// The asset whose files `fetch` gives by name, `asset.json` first.
    ///
    /// Names are plain file names: no folders. Every payload's digest, format, size and values are checked.
    pub fn decode(fetch: &mut dyn FnMut(&str) -> Result<Vec<u8>, Error>) -> Result<Self, Error> {
        decode_bounded(&mut |path, _| fetch(path))
    }

    /// The asset in the folder `dir`.
    ///
    /// No more of a file is read than its content can need.
    pub fn read(dir: &Path) -> Result<Self, Error> {
        decode_bounded(&mut |path, most| read_bounded(dir, path, most))
    }

    /// The payload files of the asset in the folder `dir`, their digests checked.
    pub fn files(dir: &Path) -> Result<Vec<PayloadFile>, Error> {
        let document = Document::parse(&read_bounded(dir, DOCUMENT, MAX_DOCUMENT_LENGTH)?)?;
        let mut found = Vec::new();
        for level in &document.levels {
            for (role, file) in files_of(level)? {
                let most = ktx2::max_file_length(role.format(), role.size(level));
                let bytes = fetch_checked(file, most, &mut |path, most| read_bounded(dir, path, most))?.len() as u64;
                let (role, path, digest) = (file.role.clone(), file.path.clone(), file.digest.clone());
                found.push(PayloadFile { level: level.index, role, path, digest, bytes });
            }
        }
        Ok(found)
    }
}

fn decode_bounded(fetch: &mut Fetch<'_>) -> Result<VolumeAsset, Error> {
    let document = Document::parse(&fetch(DOCUMENT, MAX_DOCUMENT_LENGTH)?)?;
    let levels = document.levels.iter().map(|level| decode_level(level, fetch)).collect::<Result<_, _>>()?;
    Ok(document.into_asset(levels))
}

/// The files of a level with their roles, in the order of the roles.
fn files_of(level: &LevelDocument) -> Result<Vec<(Role, &FileDocument)>, Error> {
    let roles = Role::all(level.lobes);
    let names: Vec<String> = roles.iter().map(|role| role.name()).collect();
    Ok(roles.into_iter().zip(files_of_roles(level.index, &level.files, &names)?).collect())
}

/// A level's textures, as they come.
#[derive(Default)]
struct Textures {
    density: Vec<f16>,
    /// `[lobe]`.
    shape: Vec<Vec<[u8; 4]>>,
    albedo: Vec<Vec<[u8; 4]>>,
    shear: Vec<Vec<u8>>,
}

fn decode_level(level: &LevelDocument, fetch: &mut Fetch<'_>) -> Result<VolumeLevel, Error> {
    let mut bricks = None;
    let mut textures = Textures::default();
    let files = files_of(level)?;
    let path_of = |role: Role| files.iter().find(|(other, _)| *other == role).map_or("", |(_, file)| &file.path);
    for &(role, file) in &files {
        let most = ktx2::max_file_length(role.format(), role.size(level));
        let bytes = fetch_checked(file, most, fetch)?;
        match (role, ktx2::read(&file.path, &bytes, role.format(), role.size(level))?) {
            (Role::Bricks, Texels::Index(index)) => bricks = Some(bricks_of(level, &file.path, index)?),
            (_, Texels::HalfSingle(density)) => textures.density = density,
            (Role::Shape(_), Texels::Bytes(texels)) => textures.shape.push(texels),
            (_, Texels::Bytes(texels)) => textures.albedo.push(texels),
            (_, Texels::Byte(texels)) => textures.shear.push(texels),
            _ => unreachable!("`read` gives what it was asked for"),
        }
    }
    let bricks = bricks.expect("every level has its role `bricks`");
    let filled = bricks.voxels().filter(|stored| textures.density[stored.texel] != f16::ZERO);
    let mut stored: Vec<(usize, usize)> = filled.map(|stored| (stored.voxel, stored.texel)).collect();
    stored.sort_unstable();
    if stored.len() != level.occupied {
        let wanted = format!("{} occupied voxels", level.occupied);
        return Err(Error::malformed(path_of(Role::Density), "texels", wanted, stored.len()));
    }
    let mut decoded = VolumeLevel {
        index: level.index,
        factor: level.factor,
        size: level.size,
        occupied: stored.iter().map(|&(voxel, _)| voxel as u32).collect(),
        density: Vec::with_capacity(stored.len()),
        lobes: vec![Vec::with_capacity(stored.len()); level.lobes],
        error: level.error.clone(),
        fit: level.fit.clone(),
        limited_by: level.limited_by.clone(),
    };
    for (_, texel) in stored {
        decoded.density.push(density_of(level, path_of(Role::Density), texel, textures.density[texel])?);
        let lobes = lobes_of(level, &textures, texel).ok_or_else(|| {
            Error::malformed(path_of(Role::Shape(0)), format!("texel {texel}"), "flakes in an occupied voxel", "none")
        })?;
        decoded.lobes.iter_mut().zip(lobes).for_each(|(list, lobe)| list.push(lobe));
    }
    Ok(decoded)
}

/// The brick index of the file `path`: its entries are numbered in their order.
fn bricks_of(level: &LevelDocument, path: &str, index: Vec<u32>) -> Result<Bricks, Error> {
    let entries = index.clone();
    Bricks::from_index(level.size, index, level.bricks).map_err(|(entry, wanted)| match entries.get(entry) {
        Some(found) => Error::malformed(path, format!("texel {entry}"), format!("0 or {wanted}"), found),
        None => Error::malformed(path, "texels", format!("{wanted} bricks"), "another number"),
    })
}

/// The density of a texel of the file `path`, 1/m.
fn density_of(level: &LevelDocument, path: &str, texel: usize, value: f16) -> Result<f32, Error> {
    let value = value.to_f32();
    // Written so that NaN fails too.
    if !(value > 0.0 && value <= MAX_STORED_DENSITY) {
        let wanted = format!("a density from 0 to {MAX_STORED_DENSITY}");
        return Err(Error::malformed(path, format!("texel {texel}"), wanted, format!("{value:?}")));
    }
    Ok(value * level.density)
}

/// The lobes of a texel; `None` where there is none.
fn lobes_of(level: &LevelDocument, textures: &Textures, texel: usize) -> Option<Vec<FlakeLobe>> {
    let codes: Vec<[u8; 6]> = (0..level.lobes)
        .map(|lobe| {
            let [xx, yy, zz, xy] = textures.shape[lobe][texel];
            let codes = [xx, yy, zz, xy, textures.albedo[lobe][texel][3], textures.shear[lobe][texel]];
            if codes[..3] == [0; 3] { UNUSED } else { codes }
        })
        .collect();
    let albedo = |lobe: usize| {
        let [r, g, b, _] = textures.albedo[lobe][texel];
        albedo_of([r, g, b], &level.albedo[lobe])
    };
    unpack(&codes, (0..level.lobes).map(albedo))
}
