//! The base BRDF: a Lambertian part plus a GGX conductor with Schlick's Fresnel term.

/// A base BRDF: `diffuse`/π plus an optional rough conductor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brdf {
    /// Albedo of the Lambertian part, linear RGB in [0, 1]; 0 for a pure conductor.
    pub diffuse: [f32; 3],
    /// The rough specular part.
    pub specular: Option<Conductor>,
}

/// A GGX conductor with Schlick's Fresnel term and height-correlated Smith shadowing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// Roughness α of GGX, 0 < α <= 1.
    pub alpha: f32,
    /// Reflectance at normal incidence, linear RGB in [0, 1].
    pub f0: [f32; 3],
}
