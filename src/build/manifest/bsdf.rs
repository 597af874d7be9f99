//! The keys of `bsdf = { type = … }`.

use super::fields::{Fields, number};
use crate::material::{Brdf, Conductor};

/// The types of BRDF that are compiled.
const TYPES: [&str; 2] = ["diffuse", "conductor"];

/// The types that are not compiled yet.
const LATER_TYPES: [&str; 2] = ["plastic", "blinn-phong"];

/// What an RGB value may be, for messages.
const RGB: &str = "three numbers from 0 to 1 (linear RGB)";

/// Reads a base BRDF; `None` where something is missing or wrong, which is then noted.
pub(super) fn read(fields: &mut Fields<'_, '_, '_, '_>) -> Option<Brdf> {
    let wanted = TYPES.map(|name| format!("`\"{name}\"`")).join(" or ");
    fields.require("type", &wanted);
    let kind = fields.text("type", &wanted)?;
    match kind.as_str() {
        "diffuse" => {
            fields.require("albedo", RGB);
            Some(Brdf { diffuse: rgb(fields, "albedo")?, specular: None })
        }
        "conductor" => {
            let is_bare = !fields.has("albedo");
            let diffuse = rgb(fields, "albedo").or(is_bare.then_some([0.0; 3]));
            let specular = read_conductor(fields);
            Some(Brdf { diffuse: diffuse?, specular: Some(specular?) })
        }
        _ => {
            for key in ["albedo", "distribution", "roughness", "specular", "eta", "k", "ior", "exponent"] {
                let _ = fields.raw(key); // which keys belong to an unknown type cannot be said
            }
            let found = match LATER_TYPES.contains(&kind.as_str()) {
                true => format!("`type` `{kind}` is not supported in this version"),
                false => format!("`type` is `\"{kind}\"`"),
            };
            fields.mistake("type", format!("{found}; wanted {wanted}"));
            None
        }
    }
}

/// The rough specular part of a conductor.
fn read_conductor(fields: &mut Fields<'_, '_, '_, '_>) -> Option<Conductor> {
    match fields.text("distribution", "`\"ggx\"`").as_deref() {
        None | Some("ggx") => {}
        Some("beckmann") => fields.mistake(
            "distribution",
            "`distribution` `beckmann` is not supported in this version; wanted `\"ggx\"`".into(),
        ),
        Some(other) => fields.mistake("distribution", format!("`distribution` is `\"{other}\"`; wanted `\"ggx\"`")),
    }
    for key in ["eta", "k"] {
        let message = format!("`{key}` is not supported in this version; wanted `specular`, {RGB}");
        fields.refuse(key, &message);
    }
    if !fields.has("eta") && !fields.has("k") {
        fields.require("specular", RGB);
    }
    let f0 = rgb(fields, "specular");
    let alpha = read_roughness(fields);
    Some(Conductor::ggx(alpha?, f0?))
}

/// α of GGX.
fn read_roughness(fields: &mut Fields<'_, '_, '_, '_>) -> Option<f32> {
    let wanted = "a number greater than 0 and at most 1";
    fields.require("roughness", wanted);
    let (_, value) = fields.raw("roughness")?;
    if value.get_ref().is_array() {
        let message = format!("anisotropic `roughness` is not supported in this version; wanted {wanted}");
        fields.mistake("roughness", message);
        return None;
    }
    // Below 1e-4 the lobe is narrower than single precision can resolve.
    fields
        .value("roughness", wanted, |value| number(value).filter(|n| *n > 0.0 && *n <= 1.0))
        .map(|alpha| (alpha as f32).max(MIN_ALPHA))
}

/// The smallest α: narrower lobes are sharper than single precision resolves.
const MIN_ALPHA: f32 = 1e-4;

/// Three numbers in [0, 1].
fn rgb(fields: &mut Fields<'_, '_, '_, '_>, key: &'static str) -> Option<[f32; 3]> {
    fields.numbers::<3>(key, RGB, |n| (0.0..=1.0).contains(&n)).map(|rgb| rgb.map(|n| n as f32))
}
