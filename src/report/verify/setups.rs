//! The lights and views that every level is seen under: fixed relative to the size of what the image shows.

use std::f64::consts::TAU;

use glam::DVec3;

use crate::build::SurfaceSpec;
use crate::geometry::{Boundary, HeightField};
use crate::report::verification::{Light, LightSetting, View, ViewSetting};
use crate::transport::camera::{Camera, Projection};
use crate::transport::light::{self, AreaLight, DirectionalLight, ImageLight, Lights};

/// Azimuth of the camera from +x towards +z: off the axes and diagonals that weaves run along.
const CAMERA_AZIMUTH: f64 = 0.11 * TAU;
/// The area light: where from, in image widths, and how large.
const AREA_PLACE: [f64; 3] = [-0.9, 1.3, 0.5];
const AREA_SIDE: f64 = 0.8;
const AREA_RADIANCE: f32 = 6.0;
/// The grazing light: polar angle and azimuth.
const GRAZING_POLAR_DEGREES: f64 = 75.0;
const GRAZING_AZIMUTH: f64 = 0.57 * TAU;
const GRAZING_IRRADIANCE: f32 = 4.0;
/// The image: columns and rows.
const SKY_SIZE: [usize; 2] = [256, 128];

/// What is photographed: where its levels are seen from.
#[derive(Clone, Copy, Debug)]
pub(in crate::report) struct Subject {
    /// Metres covered by the map.
    pub(in crate::report) size: [f64; 2],
    /// Source texels along u and v.
    pub(in crate::report) texels: [usize; 2],
    /// What lies beyond the map.
    pub(in crate::report) boundary: Boundary,
    /// Metres from the lowest to the highest point.
    pub(in crate::report) relief: f64,
}

/// A camera and how many tiles it needs.
#[derive(Clone, Copy, Debug)]
pub(in crate::report) struct Shot {
    pub(in crate::report) camera: Camera,
    pub(in crate::report) tiles: [u32; 2],
    /// Metres across the image.
    pub(in crate::report) width: f64,
}

/// Tiles beyond the image on either side, for shadows and slanted rays that start outside of it.
const MARGIN_TILES: f64 = 1.0;
/// The part of a map that does not repeat that the image may show.
const CLAMP_SHARE: f64 = 0.8;

impl Subject {
    /// The map of `spec`, as read.
    pub(in crate::report) fn new(spec: &SurfaceSpec, heights: &HeightField) -> Self {
        let [low, high] = heights.range().map(f64::from);
        Self { size: spec.size, texels: heights.size(), boundary: spec.boundary, relief: high - low }
    }

    /// The parallel view of `view` in which a pixel's footprint is `texels` source texels (the root of its area).
    pub(in crate::report) fn shot(&self, view: View, texels: f64, pixels: usize) -> Shot {
        let polar = view.degrees().to_radians();
        let texel = (self.size[0] / self.texels[0] as f64 * (self.size[1] / self.texels[1] as f64)).sqrt();
        // the footprint is longer by 1/cos along the view
        let mut width = pixels as f64 * texels * texel * polar.cos().sqrt();
        let depth = 1.0 / polar.cos();
        if self.boundary == Boundary::Clamp {
            width = width.min(CLAMP_SHARE * self.size[0].min(self.size[1]) / depth);
        }
        let reach = width * depth + 2.0 * self.relief * polar.tan();
        let tiles = match self.boundary {
            Boundary::Clamp => [1, 1],
            Boundary::Repeat => self.size.map(|size| (reach / size + 2.0 * MARGIN_TILES).ceil() as u32),
        };
        let away = DVec3::new(polar.sin() * CAMERA_AZIMUTH.cos(), polar.cos(), polar.sin() * CAMERA_AZIMUTH.sin());
        let up = if polar == 0.0 { DVec3::NEG_Z } else { DVec3::Y };
        let distance = 2.0 * (reach + self.relief);
        let projection = Projection::Orthographic { width };
        let camera = Camera::look_at(away * distance, DVec3::ZERO, up, projection, [pixels; 2])
            .expect("the view is not along its own up");
        Shot { camera, tiles, width }
    }
}

/// The light `light` for an image of `width` metres.
pub(in crate::report) fn lights(light: Light, width: f64, relief: f64) -> Lights {
    Lights::new(vec![match light {
        Light::Area => {
            let scale = width.max(4.0 * relief);
            let centre = DVec3::from_array(AREA_PLACE) * scale;
            let side = AREA_SIDE * scale;
            light::Light::Area(AreaLight::facing(centre, DVec3::ZERO, Some(DVec3::Z), [side; 2], [AREA_RADIANCE; 3]))
        }
        Light::Image => {
            let texels = (0..SKY_SIZE[0] * SKY_SIZE[1]).map(sky).collect();
            light::Light::Image(ImageLight::new(texels, SKY_SIZE, 1.0, 0.0))
        }
        Light::Grazing => {
            let polar = GRAZING_POLAR_DEGREES.to_radians();
            let direction =
                DVec3::new(polar.sin() * GRAZING_AZIMUTH.cos(), polar.cos(), polar.sin() * GRAZING_AZIMUTH.sin());
            light::Light::Directional(DirectionalLight {
                direction: direction.as_vec3(),
                irradiance: [GRAZING_IRRADIANCE; 3],
            })
        }
    }])
}

/// Radiance of texel `k` of the image light: a bluish sky, a warm key light and a cool, broader fill; black below.
fn sky(k: usize) -> [f32; 3] {
    let [column, row] = [k % SKY_SIZE[0], k / SKY_SIZE[0]].map(|i| i as f64 + 0.5);
    let polar = row / SKY_SIZE[1] as f64 * TAU / 2.0;
    let azimuth = column / SKY_SIZE[0] as f64 * TAU;
    let direction = DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin());
    if direction.y <= 0.0 {
        return [0.0; 3];
    }
    let lobe = |towards: [f64; 3], sharpness: f64| {
        (sharpness * (direction.dot(DVec3::from_array(towards).normalize()) - 1.0)).exp()
    };
    let [key, fill] = [lobe([0.5, 0.7, 0.4], 80.0), lobe([-0.8, 0.4, -0.3], 12.0)];
    let [bottom, top] = [[0.5, 0.55, 0.6], [0.15, 0.25, 0.5]];
    [0, 1, 2].map(|c| {
        let sky = bottom[c] + (top[c] - bottom[c]) * direction.y;
        (sky + key * [30.0, 26.0, 20.0][c] + fill * [0.8, 1.2, 2.0][c]) as f32
    })
}

/// The lights in words.
pub(super) fn light_settings() -> Vec<LightSetting> {
    let description = |light| match light {
        Light::Area => format!(
            "square of {AREA_SIDE} image widths, centre {AREA_PLACE:?} image widths (y up) from that of the image, radiance {AREA_RADIANCE}"
        ),
        Light::Image => "sky with a warm key light (κ = 80) and a cool fill (κ = 12), black below the horizon".into(),
        Light::Grazing => format!(
            "parallel light {GRAZING_POLAR_DEGREES}° from the normal, irradiance {GRAZING_IRRADIANCE} on a plane that faces it"
        ),
    };
    Light::ALL.map(|light| LightSetting { light, description: description(light) }).to_vec()
}

/// The views in words.
pub(super) fn view_settings() -> Vec<ViewSetting> {
    let description = |view: View| {
        format!(
            "parallel camera {}° from the normal, {:.0}° from +u; a pixel's footprint is a cell of the level",
            view.degrees(),
            CAMERA_AZIMUTH.to_degrees()
        )
    };
    View::ALL.map(|view| ViewSetting { view, description: description(view) }).to_vec()
}
