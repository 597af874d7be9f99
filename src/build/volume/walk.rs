//! What the asset of a volume depends on.

use std::collections::BTreeMap;
use std::path::Path;

use super::super::inputs::InputDigests;
use super::super::key::{Digest, Walk};
use super::super::manifest::{AlbedoSpec, AlongSpec, DensitySpec, GridSpec, SggxSpec, VolumeSpec};
use super::encode::VOLUME_VERSION;
use crate::io::grid::RawLayout;
use crate::prefilter::volume::orientation::OrientationSettings;

/// The action that a volume is.
pub(in crate::build) const ACTION: &str = "volume";

/// The digests of a volume's files, by the manifest's key.
pub(in crate::build) type VolumeFiles = BTreeMap<&'static str, Digest>;

/// The digests of the files of `spec`, whose paths are relative to `folder`; an error is one line.
pub(in crate::build) fn files_of(
    spec: &VolumeSpec,
    folder: &Path,
    digests: &InputDigests,
) -> Result<VolumeFiles, String> {
    let digest = |(key, grid): (&'static str, &GridSpec)| Ok((key, digests.digest(&folder.join(&grid.file))?));
    spec.grids().into_iter().map(digest).collect::<Result<_, crate::io::Error>>().map_err(|error| error.to_string())
}

/// Everything that the asset of a volume depends on.
pub(in crate::build) fn walk_volume(spec: &VolumeSpec, files: &VolumeFiles) -> Walk {
    let mut walk = Walk::new(ACTION, VOLUME_VERSION);
    files.iter().for_each(|(key, digest)| walk.input(key, *digest));
    // Taken apart, so that no setting is forgotten that comes later. Paths are no part of what is made.
    let VolumeSpec {
        name,
        density: DensitySpec { grid: density, window, scale },
        albedo,
        sggx,
        voxel,
        repeat,
        levels,
        lobes,
        clusters,
        optimizer,
        error,
        seed,
    } = spec;
    walk.setting("name", name);
    walk_grid(&mut walk, "density", density);
    walk.setting("window", window);
    walk.setting("scale", scale);
    match albedo {
        AlbedoSpec::Constant(rgb) => walk.setting("albedo", rgb),
        AlbedoSpec::Grid(grid) => walk_grid(&mut walk, "albedo", grid),
    }
    walk_sggx(&mut walk, sggx);
    walk.setting("voxel", voxel);
    walk.setting("repeat", repeat);
    walk.setting("levels", levels);
    walk.setting("lobes", lobes);
    walk.setting("clusters", clusters);
    walk.setting("optimizer", optimizer.name());
    walk.setting("error", error);
    walk.setting("seed", seed);
    walk
}

fn walk_sggx(walk: &mut Walk, sggx: &SggxSpec) {
    match sggx {
        SggxSpec::Matrices(grid) => walk_grid(walk, "sggx", grid),
        SggxSpec::Fibres { directions, along } => {
            walk_grid(walk, "fibre", directions);
            walk_along(walk, along);
        }
        SggxSpec::StructureTensor { settings: OrientationSettings { sigma, rho }, along } => {
            walk.setting("sigma", sigma);
            walk.setting("rho", rho);
            walk_along(walk, along);
        }
    }
}

fn walk_along(walk: &mut Walk, along: &AlongSpec) {
    match along {
        AlongSpec::Constant(along) => walk.setting("along", along),
        AlongSpec::Areas(grid) => walk_grid(walk, "along", grid),
        AlongSpec::Eigenvalues(grid) => walk_grid(walk, "eigenvalue", grid),
    }
}

/// What is said of the file of `key`: what it holds, where it is a bare array.
fn walk_grid(walk: &mut Walk, key: &str, grid: &GridSpec) {
    let GridSpec { file: _, layout } = grid;
    walk.setting(key, layout.as_ref().map_or("grid", |_| "bare array"));
    if let Some(RawLayout { size, sample, order, is_big_endian }) = layout {
        walk.setting(&format!("{key} size"), size);
        walk.setting(&format!("{key} type"), sample);
        walk.setting(&format!("{key} order"), order);
        walk.setting(&format!("{key} big endian"), is_big_endian);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::build::Manifest;

    /// The volume of a manifest with these lines in place of its own.
    fn spec(lines: &[(&str, &str)]) -> VolumeSpec {
        let mut keys = BTreeMap::from([
            ("density", "{ file = \"d.raw\", size = [8, 8, 8], type = \"u8\" }"),
            ("albedo", "[0.9, 0.8, 0.7]"),
            ("sggx", "{ from = \"structure-tensor\", along = 0.1 }"),
            ("voxel", "1e-4"),
            ("levels", "[2, 4]"),
        ]);
        keys.extend(lines.iter().copied());
        let text: String = keys.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
        Manifest::parse(&format!("[volume.cloth]\n{text}")).unwrap().volumes.remove(0)
    }

    #[test]
    fn every_setting_and_every_file_reaches_the_key() {
        let raw = |more: &str| format!("{{ file = \"d.raw\", size = [8, 8, 8], type = \"u8\", {more} }}");
        let [window, scale, order, endian] =
            ["window = [3, 9]", "scale = 2", "order = \"zyx\"", "endian = \"big\""].map(raw);
        let changes: &[&[(&str, &str)]] = &[
            &[],
            &[("density", &window)],
            &[("density", &scale)],
            &[("density", &order)],
            &[("density", &endian)],
            &[("density", "{ file = \"d.raw\", size = [8, 8, 4], type = \"u16\" }")],
            &[("density", "\"d.raw\"")],
            &[("albedo", "[0.9, 0.8, 0.6]")],
            &[("albedo", "\"a.vol\"")],
            &[("sggx", "{ from = \"structure-tensor\", along = 0.2 }")],
            &[("sggx", "{ from = \"structure-tensor\", along = 0.1, sigma = 2 }")],
            &[("sggx", "{ from = \"structure-tensor\", along = 0.1, rho = 2 }")],
            &[("sggx", "{ from = \"structure-tensor\", along = \"s.vol\" }")],
            &[("sggx", "{ from = \"structure-tensor\", eigenvalue = \"s.vol\" }")],
            &[("sggx", "{ fibre = \"s.vol\", along = 0.1 }")],
            &[("sggx", "{ file = \"s.vol\" }")],
            &[("voxel", "[1e-4, 1e-4, 2e-4]")],
            &[("repeat", "[true, false, false]")],
            &[("levels", "[2, 8]")],
            &[("lobes", "2")],
            &[("clusters", "2")],
            &[("optimizer", "\"sgd\"")],
            &[("error", "0.5")],
            &[("seed", "1")],
        ];
        let key = |spec: &VolumeSpec, content: &str| {
            let digest = |(key, _)| (key, Digest::of(format!("{key} {content}").as_bytes()));
            walk_volume(spec, &spec.grids().into_iter().map(digest).collect()).key()
        };
        let keys: BTreeSet<Digest> = changes
            .iter()
            .flat_map(|lines| ["old", "new"].map(|content| key(&spec(lines), content)))
            .chain([key(&VolumeSpec { name: "felt".into(), ..spec(&[]) }, "old")])
            .collect();
        assert_eq!(keys.len(), 2 * changes.len() + 1);
        // Another place of the same bytes is the same volume.
        let moved = spec(&[("density", "{ file = \"e.raw\", size = [8, 8, 8], type = \"u8\" }")]);
        assert_eq!(key(&moved, "old"), key(&spec(&[]), "old"));
    }
}
