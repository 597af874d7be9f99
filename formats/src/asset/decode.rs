//! An asset from the bytes of its files.

use super::document::{Document, FileDocument, LevelDocument, is_digest};
use super::payload::{Role, amounts_of, colors_of, heights_of, lobes_of};
use super::{AdditiveTerm, DOCUMENT, SurfaceAsset, SurfaceLevel};
use crate::Error;
use crate::ktx2::{self, Texels};
use half::f16;

/// Gives the bytes of the file of this name, of which there are at most so many.
pub(crate) type Fetch<'a> = dyn FnMut(&str, u64) -> Result<Vec<u8>, Error> + 'a;

impl SurfaceAsset {
    /// The asset whose files `fetch` gives by name, `asset.json` first.
    ///
    /// Names are plain file names: no folders. Every payload's digest, format, size and values are checked.
    pub fn decode(fetch: &mut dyn FnMut(&str) -> Result<Vec<u8>, Error>) -> Result<Self, Error> {
        Self::decode_bounded(&mut |path, _| fetch(path))
    }

    pub(super) fn decode_bounded(fetch: &mut Fetch<'_>) -> Result<Self, Error> {
        let document = Document::parse(&fetch(DOCUMENT, super::document::MAX_DOCUMENT_LENGTH)?)?;
        let levels = document.levels.iter().map(|level| decode_level(level, fetch)).collect::<Result<_, _>>()?;
        Ok(document.into_asset(levels))
    }
}

/// The files of a level with their roles, in the order of the roles: each exactly once, under a safe name.
pub(super) fn files_of(level: &LevelDocument) -> Result<Vec<(Role, &FileDocument)>, Error> {
    let roles = level.shape().roles();
    let files = files_of_roles(level.index, &level.files, &roles.iter().map(|role| role.name()).collect::<Vec<_>>())?;
    Ok(roles.into_iter().zip(files).collect())
}

/// The files of the roles `names` of level `index`, in their order: each exactly once, under a safe name, and no other.
pub(crate) fn files_of_roles<'a>(
    index: u32,
    files: &'a [FileDocument],
    names: &[String],
) -> Result<Vec<&'a FileDocument>, Error> {
    let place = |what: &str| format!("level {index}, {what}");
    if let Some(file) = files.iter().find(|file| !names.contains(&file.role)) {
        let found = format!("`{}`", file.role);
        return Err(Error::malformed(DOCUMENT, place("`files`"), "only the roles that its counts ask for", found));
    }
    let find = |name: &String| {
        let mut files = files.iter().filter(|file| file.role == *name);
        let (file, second) = (files.next(), files.next());
        let count = if second.is_some() { "two" } else { "none" };
        let file = file.filter(|_| second.is_none());
        let file = file.ok_or_else(|| Error::malformed(DOCUMENT, place("`files`"), format!("one `{name}`"), count))?;
        check_name(file).map_err(|(wanted, found)| Error::malformed(DOCUMENT, place(name), wanted, found))?;
        Ok(file)
    };
    names.iter().map(find).collect()
}

/// A plain file name of letters, digits, `.`, `_` and `-` that leaves the asset's folder on no system.
fn check_name(file: &FileDocument) -> Result<(), (&'static str, String)> {
    const MAX_NAME: usize = 200;
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
    let path = &file.path;
    if path.len() > MAX_NAME || !path.ends_with(".ktx2") || path.starts_with('.') || !path.bytes().all(plain) {
        return Err(("a plain file name that ends in `.ktx2`", format!("{path:?}")));
    }
    if !is_digest(&file.digest) {
        return Err(("a digest of 64 hex digits", format!("{:?}", file.digest)));
    }
    Ok(())
}

/// The bytes of a payload, if they are those that were published.
pub(crate) fn fetch_checked(file: &FileDocument, most: u64, fetch: &mut Fetch<'_>) -> Result<Vec<u8>, Error> {
    let bytes = fetch(&file.path, most)?;
    let found = blake3::hash(&bytes).to_hex();
    if found.as_str() != file.digest {
        let (path, wanted, found) = (file.path.clone(), file.digest.clone(), found.to_string());
        return Err(Error::Digest { path, wanted, found });
    }
    Ok(bytes)
}

fn decode_level(level: &LevelDocument, fetch: &mut Fetch<'_>) -> Result<SurfaceLevel, Error> {
    let shape = level.shape();
    let mut decoded = SurfaceLevel {
        index: level.index,
        factor: level.factor,
        cells: shape.cells,
        heights: Vec::new(),
        lobes: Vec::new(),
        base_color: None,
        patches: shape.patches,
        spatial: Vec::new(),
        directions: shape.directions,
        angular: Vec::new(),
        additive: shape.additive.map(|directions| AdditiveTerm {
            directions,
            spatial: Vec::new(),
            angular: Vec::new(),
        }),
        skipped_interreflection: level.skipped_interreflection,
        error: level.error,
        limited_by: level.limited_by.clone(),
        alternatives: level.alternatives.clone(),
    };
    for (role, file) in files_of(level)? {
        let most = ktx2::max_file_length(role.format(), shape.size(role));
        let bytes = fetch_checked(file, most, fetch)?;
        let path = file.path.as_str();
        match (role, ktx2::read(path, &bytes, role.format(), shape.size(role))?) {
            (Role::Heights, Texels::Single(heights)) => decoded.heights = heights_of(path, heights)?,
            (_, Texels::Half(texels)) => place_texels(&mut decoded, role, path, &texels)?,
            _ => unreachable!("`read` gives what it was asked for"),
        }
    }
    Ok(decoded)
}

fn additive(level: &mut SurfaceLevel) -> &mut AdditiveTerm {
    level.additive.as_mut().expect("the roles of the term are asked for where there is one")
}

/// Roles come in order, so ranks and lobes are pushed in theirs.
fn place_texels(level: &mut SurfaceLevel, role: Role, path: &str, texels: &[[f16; 4]]) -> Result<(), Error> {
    match role {
        Role::Heights => unreachable!("heights are not half"),
        Role::Lobe(_) => level.lobes.push(lobes_of(path, texels)?),
        Role::BaseColor => level.base_color = Some(colors_of(path, texels)?),
        Role::Spatial(_) => level.spatial.push(colors_of(path, texels)?),
        Role::Angular(_) => level.angular.push(colors_of(path, texels)?),
        Role::AdditiveSpatial => additive(level).spatial = amounts_of(path, texels)?,
        Role::AdditiveAngular => additive(level).angular = amounts_of(path, texels)?,
    }
    Ok(())
}
