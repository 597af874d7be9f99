//! Pictures of an error: FLIP in the colours of magma, signed differences from blue over grey to red.
//!
//! All models of a case share one scale, so that their maps compare; it is stated beside them. Colours follow the square
//! root of a value's size: beside a model that is far off, one that is nearly right still shows where it is not. Values
//! beyond the scale take the colour of its end.

/// Share of the values that a scale chosen by [`scale`] holds.
const SCALED_SHARE: f64 = 0.99;

/// Magma at steps of 1/16, sRGB codes of the table that FLIP is drawn with; between them linear.
const MAGMA: [[u8; 3]; 17] = [
    [0, 0, 4],
    [10, 8, 34],
    [29, 17, 71],
    [54, 16, 107],
    [81, 18, 124],
    [106, 28, 129],
    [131, 38, 129],
    [156, 46, 127],
    [183, 55, 121],
    [207, 64, 112],
    [229, 80, 100],
    [244, 105, 92],
    [251, 135, 97],
    [254, 165, 113],
    [254, 194, 135],
    [253, 224, 161],
    [252, 253, 191],
];

/// Too dark, right, too bright, at steps of 1/4: a diverging map of even lightness on both sides, safe for colour-blind
/// readers (ColorBrewer's RdBu, darkest step left out).
const DIVERGING: [[u8; 3]; 5] = [[33, 102, 172], [146, 197, 222], [247, 247, 247], [244, 165, 130], [178, 24, 43]];

/// Which colours a map has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colours {
    /// For values from 0 up to the scale.
    Sequential,
    /// For values from minus to plus the scale.
    Diverging,
}

impl Colours {
    /// The sRGB codes at equal steps along the scale.
    pub fn stops(self) -> &'static [[u8; 3]] {
        match self {
            Self::Sequential => &MAGMA,
            Self::Diverging => &DIVERGING,
        }
    }

    /// Values to name beside the colours, and where they lie: 0 to 1 along [`Self::stops`].
    pub fn ticks(self, scale: f32) -> Vec<(f32, f32)> {
        match self {
            Self::Sequential => vec![(0.0, 0.0), (0.5, scale / 4.0), (1.0, scale)],
            Self::Diverging => {
                vec![(0.0, -scale), (0.25, -scale / 4.0), (0.5, 0.0), (0.75, scale / 4.0), (1.0, scale)]
            }
        }
    }

    /// Colour of a value, sRGB in [0, 1].
    fn at(self, value: f32, scale: f32) -> [f32; 3] {
        let stops = self.stops();
        let root = (value.abs() / scale).sqrt().copysign(value);
        let fraction = match self {
            Self::Sequential => root,
            Self::Diverging => 0.5 + 0.5 * root,
        };
        // Beyond the scale the end's colour holds, as the legend says.
        let place = fraction.clamp(0.0, 1.0) * (stops.len() - 1) as f32;
        let below = (place as usize).min(stops.len() - 2);
        let weight = place - below as f32;
        let mixed = |k: usize| {
            let [low, high] = [stops[below][k], stops[below + 1][k]].map(f32::from);
            (low + weight * (high - low)) / 255.0
        };
        [0, 1, 2].map(mixed)
    }
}

/// The map as linear RGB, to be written at exposure 1.
pub fn coloured(values: &[f32], scale: f32, colours: Colours) -> Vec<[f32; 3]> {
    assert!(scale > 0.0, "a scale has an extent");
    values.iter().map(|&value| colours.at(value, scale).map(linear)).collect()
}

/// Signed difference of every pixel, model minus reference, over the mean of the reference; means over RGB.
///
/// Over the mean of the picture, not over the pixel: no division by a dark one. Where the picture is black nothing is
/// relative to it, and all differences are 0.
pub fn relative_difference(reference: &[[f32; 3]], image: &[[f32; 3]]) -> Vec<f32> {
    assert_eq!(reference.len(), image.len(), "images of one size");
    let grey = |c: &[f32; 3]| (c[0] + c[1] + c[2]) / 3.0;
    let mean = reference.iter().map(|c| f64::from(grey(c))).sum::<f64>() / reference.len() as f64;
    if mean <= 0.0 {
        return vec![0.0; image.len()];
    }
    reference.iter().zip(image).map(|(r, m)| ((f64::from(grey(m)) - f64::from(grey(r))) / mean) as f32).collect()
}

/// A round scale that holds 99 % of the sizes of the values of each map: 1, 2 or 5 times a power of ten, at least 0.01.
pub fn scale(maps: &[&[f32]]) -> f32 {
    let bound = |map: &&[f32]| {
        let mut sizes: Vec<f32> = map.iter().map(|value| value.abs()).collect();
        sizes.sort_by(f32::total_cmp);
        sizes.get(((sizes.len().max(1) - 1) as f64 * SCALED_SHARE).round() as usize).copied().unwrap_or(0.0)
    };
    // Below a hundredth a map would show the rounding of 8-bit codes.
    let bound = maps.iter().map(bound).fold(0.01, f32::max);
    let decade = 10f32.powf(bound.log10().floor());
    let rounded = [1.0, 2.0, 5.0].map(|digit| digit * decade).into_iter().find(|&s| s >= bound * (1.0 - 1e-5));
    rounded.unwrap_or(10.0 * decade)
}

/// sRGB code of linear light (IEC 61966-2-1); what is below black or above white has no code of its own.
pub(super) fn srgb_code(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let coded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (coded * 255.0).round() as u8
}

/// Linear light of an sRGB value, both in [0, 1].
fn linear(coded: f32) -> f32 {
    if coded <= 0.04045 { coded / 12.92 } else { ((coded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_survive_the_way_to_linear_light_and_back() {
        for code in 0..=255u8 {
            assert_eq!(srgb_code(linear(f32::from(code) / 255.0)), code);
        }
        assert_eq!([srgb_code(-1.0), srgb_code(f32::INFINITY)], [0, 255]);
    }

    #[test]
    fn a_map_shows_its_stops_and_the_ends_beyond_them() {
        let codes = |values: &[f32], colours| -> Vec<[u8; 3]> {
            coloured(values, 0.2, colours).into_iter().map(|c| c.map(srgb_code)).collect()
        };
        assert_eq!(codes(&[0.0, 0.05, 0.2, 9.0], Colours::Sequential), [MAGMA[0], MAGMA[8], MAGMA[16], MAGMA[16]]);
        assert_eq!(
            codes(&[-0.2, 0.0, 0.2, -9.0], Colours::Diverging),
            [DIVERGING[0], DIVERGING[2], DIVERGING[4], DIVERGING[0]]
        );
    }

    #[test]
    fn a_named_value_has_the_colour_of_its_place() {
        for colours in [Colours::Sequential, Colours::Diverging] {
            let stops = colours.stops();
            for (place, value) in colours.ticks(0.5) {
                let wanted = stops[(place * (stops.len() - 1) as f32) as usize];
                assert_eq!(coloured(&[value], 0.5, colours)[0].map(srgb_code), wanted, "{value}");
            }
        }
    }

    #[test]
    fn magma_is_that_of_flip() {
        let table = nv_flip::magma_lut().to_vec();
        for (i, entry) in table.chunks_exact(3).enumerate() {
            let ours = Colours::Sequential.at((i as f32 / 255.0).powi(2), 1.0).map(|c| c * 255.0);
            // Between stops 16 entries apart the table bends by 2 codes; both are rounded.
            let off = (0..3).map(|k| (ours[k] - f32::from(entry[k])).abs()).fold(0.0, f32::max);
            assert!(off <= 4.0, "{i}: {ours:?} {entry:?}");
        }
    }

    #[test]
    fn a_scale_is_round_and_holds_nearly_all_values() {
        for (largest, wanted) in
            [(0.0, 0.01), (0.01, 0.01), (0.012, 0.02), (0.3, 0.5), (0.5, 0.5), (0.7, 1.0), (3.0, 5.0)]
        {
            let values = [-largest; 500];
            let found = scale(&[&values, &[0.0; 10]]);
            assert!((found / wanted - 1.0).abs() < 1e-5, "{largest}: {found}");
        }
        assert_eq!(scale(&[&[]]), 0.01);
    }

    #[test]
    fn differences_are_over_the_mean_of_the_picture() {
        let reference = [[0.0; 3], [2.0; 3]];
        assert_eq!(relative_difference(&reference, &[[0.5; 3], [1.0; 3]]), [0.5, -1.0]);
        assert_eq!(relative_difference(&[[0.0; 3]], &[[1.0; 3]]), [0.0]);
    }
}
