//! The pictures of a report, as PNG.

use std::collections::BTreeMap;

use crate::report::error_map::{Colours, coloured, relative_difference, scale};
use crate::report::flip::Flip;
use crate::report::verification::{Light, Model, View};

/// Which case a picture is of.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CaseKey {
    /// Name of the asset.
    pub asset: String,
    /// Number of the level.
    pub level: u32,
    /// The light.
    pub light: Light,
    /// The view.
    pub view: View,
}

/// The pictures of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct CasePictures {
    /// PNG of the reference.
    pub reference: Vec<u8>,
    /// The models, in the order that they are offered in.
    pub models: Vec<ModelPictures>,
    /// Largest value that the FLIP maps tell apart.
    pub flip_scale: f32,
    /// Largest size that the maps of the signed difference tell apart, relative to the mean of the reference.
    pub difference_scale: f32,
}

/// The pictures of a model, PNG each.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelPictures {
    /// The model.
    pub model: Model,
    /// What it looks like.
    pub image: Vec<u8>,
    /// FLIP, coloured.
    pub flip: Vec<u8>,
    /// Signed difference, coloured.
    pub difference: Vec<u8>,
}

/// A model's image of linear radiance, and what FLIP says of it.
#[derive(Clone, Copy, Debug)]
pub struct Drawn<'a> {
    /// The model.
    pub model: Model,
    /// Its pixels, row-major.
    pub image: &'a [[f32; 3]],
    /// Their FLIP against the reference.
    pub flip: &'a Flip,
}

impl CasePictures {
    /// The pictures of a case, all at one exposure and their maps on one scale.
    ///
    /// `encode` gives the PNG of linear RGB times a factor, coded as sRGB.
    pub fn draw(
        reference: &[[f32; 3]],
        models: &[Drawn],
        exposure: f32,
        encode: impl Fn(&[[f32; 3]], f32) -> Vec<u8>,
    ) -> Self {
        let differences: Vec<Vec<f32>> = models.iter().map(|m| relative_difference(reference, m.image)).collect();
        let flip_scale = scale(&models.iter().map(|m| m.flip.map.as_slice()).collect::<Vec<_>>());
        let difference_scale = scale(&differences.iter().map(Vec::as_slice).collect::<Vec<_>>());
        let map = |values: &[f32], scale, colours| encode(&coloured(values, scale, colours), 1.0);
        let pictures = |(drawn, difference): (&Drawn, &Vec<f32>)| ModelPictures {
            model: drawn.model,
            image: encode(drawn.image, exposure),
            flip: map(&drawn.flip.map, flip_scale, Colours::Sequential),
            difference: map(difference, difference_scale, Colours::Diverging),
        };
        Self {
            reference: encode(reference, exposure),
            models: models.iter().zip(&differences).map(pictures).collect(),
            flip_scale,
            difference_scale,
        }
    }
}

/// The pictures of all cases; a case without any has its figures alone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    cases: BTreeMap<CaseKey, CasePictures>,
}

impl Pictures {
    /// Adds those of a case, in place of any that were there.
    pub fn insert(&mut self, key: CaseKey, pictures: CasePictures) {
        self.cases.insert(key, pictures);
    }

    /// Those of a case.
    pub fn of(&self, key: &CaseKey) -> Option<&CasePictures> {
        self.cases.get(key)
    }
}
