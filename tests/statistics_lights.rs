//! Lights against closed forms and their own densities: irradiance by every way of sampling, chi-square of the
//! samplers.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use farfield::io::SourceFile;
use farfield::io::environment::decode_environment;
use farfield::math::rng::Stream;
use farfield::transport::light::{AreaLight, ConstantLight, DirectionalLight, ImageLight, Light, LightSample, Lights};
use farfield::transport::{Accumulator, Estimate};
use glam::{DVec3, Vec3};

/// Standard score that one comparison of these suites may reach: 1e-5 two-sided, so that a thousand comparisons raise
/// a false alarm in 1 % of all choices of the seed.
const MAX_SCORE: f64 = 4.42;
/// Samples an estimate or a histogram takes.
const SAMPLES: u64 = 200_000;

/// Mean of `value` over [`SAMPLES`] draws of (choice, u).
fn mean(seed: u64, value: impl Fn(f32, [f32; 2]) -> f64) -> Estimate {
    let stream = Stream::new(seed, 0);
    let mut sum = Accumulator::default();
    (0..SAMPLES).for_each(|i| sum.add(value(stream.uniform(2 * i), stream.uniform_pair(2 * i + 1))));
    sum.estimate()
}

/// Irradiance in red that one sample gives a plane with the normal `normal`.
fn irradiance_of(sample: Option<LightSample>, normal: Vec3) -> f64 {
    sample.map_or(0.0, |s| f64::from(s.radiance[0]) * f64::from(s.wi.dot(normal).max(0.0)) / f64::from(s.pdf))
}

/// Fails where the estimate is further from `exact` than chance explains; `rounding` is relative.
fn expect_mean(name: &str, estimate: Estimate, exact: f64, rounding: f64) {
    let tolerance = MAX_SCORE * estimate.standard_error() + rounding * exact.abs();
    let off = (estimate.mean - exact).abs();
    assert!(off <= tolerance, "{name}: {} ± {}, wanted {exact}", estimate.mean, estimate.standard_error());
}

/// Irradiance of a rectangle of radiance 1 at `from`, wholly above the plane: ½ Σ γₖ ⟨n, Γₖ⟩ over its edges (Lambert).
///
/// γₖ is the angle between the directions to the ends of edge k, Γₖ the unit normal of the plane through it and `from`.
fn lambert(corners: [DVec3; 4], from: DVec3, normal: DVec3) -> f64 {
    let r = corners.map(|corner| corner - from);
    let edges = (0..4).map(|k| {
        let cross = r[k].cross(r[(k + 1) % 4]);
        let angle = cross.length().atan2(r[k].dot(r[(k + 1) % 4]));
        angle * cross.normalize().dot(normal)
    });
    (0.5 * edges.sum::<f64>()).abs()
}

/// An image whose texels differ by factors of up to 500, some of them black.
fn speckled(size: [usize; 2], rotation: f64) -> ImageLight {
    let stream = Stream::new(5, 0);
    let texel = |i: u64| match stream.uniform_pair(i) {
        [x, _] if x < 0.2 => [0.0; 3],
        [_, y] => [0.2 + 100.0 * y.powi(8), y, 1.0 - y],
    };
    ImageLight::new((0..(size[0] * size[1]) as u64).map(texel).collect(), size, 1.0, rotation)
}

fn constant(radiance: f32) -> Light {
    Light::Constant(ConstantLight { radiance: [radiance; 3] })
}

#[test]
fn constant_light_gives_a_plane_pi_times_its_radiance_in_every_sample() {
    let stream = Stream::new(1, 0);
    for i in 0..1000 {
        let sample = constant(0.75).sample(DVec3::ZERO, stream.uniform_pair(i));
        // Rounding of f32 alone.
        assert!((irradiance_of(sample, Vec3::Y) - 0.75 * PI).abs() < 2e-6);
    }
    let tilted = Vec3::new(0.6, 0.8, 0.0);
    // The part of the sky that a tilted plane sees above the horizon: (1 + cosθ)/2.
    let estimate = mean(2, |_, u| irradiance_of(constant(1.0).sample(DVec3::ZERO, u), tilted));
    expect_mean("tilted plane", estimate, PI * 0.9, 1e-6);
}

#[test]
fn directional_light_gives_its_irradiance_times_the_cosine() {
    let direction = Vec3::new(1.0, 2.0, -2.0) / 3.0;
    let light = Light::Directional(DirectionalLight { direction, irradiance: [3.0, 2.0, 1.0] });
    let sample = light.sample(DVec3::ZERO, [0.3, 0.9]);
    assert!((irradiance_of(sample, Vec3::Y) - 2.0).abs() < 1e-6);
    assert!(light.is_delta() && sample.unwrap().is_delta);
    assert_eq!((light.pdf(DVec3::ZERO, direction), light.emitted(DVec3::ZERO, direction)), (0.0, None));
}

#[test]
fn rectangles_give_their_form_factor() {
    let tilted = Vec3::new(0.48, 0.6, 0.64);
    for (k, (centre, a, b)) in [
        (DVec3::new(0.0, 1.0, 0.0), DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.0, 0.0, 0.5)),
        (DVec3::new(0.0, 0.01, 0.0), DVec3::new(3.0, 0.0, 0.0), DVec3::new(0.0, 0.0, 2.0)),
        (DVec3::new(4.0, 2.5, 1.0), DVec3::new(0.3, 0.4, 0.0), DVec3::new(0.0, 0.0, 2.0)),
        (DVec3::new(1.0, 1.01, 1.03), DVec3::new(0.0, 1.0, 0.0), DVec3::new(0.02, 0.0, 0.02)),
        (DVec3::new(30.0, 40.0, 10.0), DVec3::new(0.02, 0.0, 0.0), DVec3::new(0.0, 0.0, 0.02)),
        (DVec3::new(0.2, 3000.0, 0.5), DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.0, 0.0, 1.0)),
    ]
    .into_iter()
    .enumerate()
    {
        let from = DVec3::ZERO;
        // The front faces the lit point.
        let half_edges = if a.cross(b).dot(from - centre) > 0.0 { [a, b] } else { [b, a] };
        let light = Light::Area(AreaLight::new(centre, half_edges, [1.0; 3]));
        let corners = [-a - b, a - b, a + b, -a + b].map(|d| centre + d);
        for normal in [Vec3::Y, tilted].into_iter().filter(|n| corners.iter().all(|c| n.as_dvec3().dot(*c) > 0.0)) {
            let estimate = mean(10 + k as u64, |_, u| irradiance_of(light.sample(from, u), normal));
            // The closed form of a far rectangle cancels: 1e-15 over its solid angle.
            expect_mean(&format!("rectangle {k}, {normal}"), estimate, lambert(corners, from, normal.as_dvec3()), 1e-6);
        }
        assert!(light.sample(2.0 * centre - from, [0.5; 2]).is_none(), "dark from behind");
    }
}

#[test]
fn every_light_that_can_be_a_constant_sky_gives_the_same() {
    let sky = constant(1.0);
    let image = Light::Image(ImageLight::new(vec![[1.0; 3]; 31 * 16], [31, 16], 1.0, 0.4));
    let half = 1000.0;
    let edges = [DVec3::new(half, 0.0, 0.0), DVec3::new(0.0, 0.0, half)];
    let ceiling = Light::Area(AreaLight::new(DVec3::Y, edges, [1.0; 3]));
    // A ceiling a thousand times as wide as high misses less than 1/1000² of the sky.
    for normal in [Vec3::Y, Vec3::new(0.28, 0.96, 0.0)] {
        let exact = PI * f64::from(0.5 + 0.5 * normal.y);
        for (name, light, missing) in [("constant", &sky, 1e-6), ("image", &image, 1e-6), ("ceiling", &ceiling, 2e-3)] {
            let estimate = mean(20, |_, u| irradiance_of(light.sample(DVec3::ZERO, u), normal));
            expect_mean(&format!("{name}, {normal}"), estimate, exact, missing);
        }
    }
}

/// Σ L ∫ y dω over the texels above the horizon, in red.
fn summed_irradiance(image: &ImageLight, size: [usize; 2], rotation: f64) -> f64 {
    let step = [TAU / size[0] as f64, PI / size[1] as f64];
    let rim = |v: usize| (step[1] * v as f64).cos().max(0.0).powi(2);
    let texel = |i: usize| {
        let (u, v) = (i % size[0], i / size[0]);
        let centre = [step[0] * (u as f64 + 0.5) - PI - rotation, step[1] * (v as f64 + 0.5)];
        f64::from(image.radiance(spherical(centre))[0]) * step[0] * 0.5 * (rim(v) - rim(v + 1))
    };
    (0..size[0] * size[1]).map(texel).sum()
}

#[test]
fn an_image_gives_the_sum_over_its_texels() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/environments/studio.exr");
    let studio = decode_environment(&SourceFile::read(path.as_ref()).unwrap()).unwrap();
    let studio = ImageLight::new(studio.texels, [studio.width, studio.height], 2.0, 0.9);
    for (image, size) in [(speckled([16, 8], 0.9), [16, 8]), (speckled([9, 5], 0.9), [9, 5]), (studio, [1024, 512])] {
        let exact = summed_irradiance(&image, size, 0.9);
        let light = Light::Image(image);
        let estimate = mean(30, |_, u| irradiance_of(light.sample(DVec3::ZERO, u), Vec3::Y));
        expect_mean(&format!("image {size:?}"), estimate, exact, 1e-6);
    }
}

/// Direction of (azimuth from −z towards +x, angle from +y).
fn spherical([azimuth, polar]: [f64; 2]) -> Vec3 {
    DVec3::new(polar.sin() * azimuth.sin(), polar.cos(), -polar.sin() * azimuth.cos()).as_vec3()
}

/// The lights of the tests of several: two rectangles of which one hides part of the other, a sky, a sun and an image.
fn several() -> Lights {
    let edges = |half: f64| [DVec3::new(half, 0.0, 0.0), DVec3::new(0.0, 0.0, half)];
    Lights::new(vec![
        Light::Area(AreaLight::new(DVec3::new(0.3, 1.0, 0.0), edges(0.4), [4.0; 3])),
        constant(0.5),
        Light::Directional(DirectionalLight { direction: Vec3::new(0.6, 0.8, 0.0), irradiance: [2.0; 3] }),
        Light::Area(AreaLight::new(DVec3::new(0.0, 2.0, 0.5), edges(0.9), [1.0; 3])),
        Light::Image(speckled([8, 4], 0.0)),
        Light::Area(AreaLight::new(DVec3::new(-2.0, 0.5, 0.0), [DVec3::Z, DVec3::Y * 0.2], [9.0; 3])),
    ])
}

/// A sample of irradiance by directions that follow the cosine about y.
fn by_cosine(lights: &Lights, u: [f32; 2]) -> (Vec3, f64, [f32; 3]) {
    let wi = constant(1.0).sample(DVec3::ZERO, u).map_or(Vec3::X, |s| s.wi);
    (wi, f64::from(wi.y) / PI, lights.emitted(DVec3::ZERO, wi, f64::INFINITY))
}

#[test]
fn lights_and_cosine_find_the_same_irradiance_alone_and_weighed_together() {
    let lights = several();
    let sun_only = Lights::new(vec![lights.as_slice()[2].clone()]);
    let sun = irradiance_of(sun_only.sample(DVec3::ZERO, 0.0, [0.0; 2]), Vec3::Y);
    // The sun stands at (0.6, 0.8, 0): one metre up it is at x = 0.75, beyond the lower rectangle; two metres up at
    // x = 1.5, beyond the upper. Nothing hides it.
    let lit = mean(40, |choice, u| irradiance_of(lights.sample(DVec3::ZERO, choice, u), Vec3::Y));
    let cosine = mean(41, |_, u| {
        let (wi, pdf, radiance) = by_cosine(&lights, u);
        f64::from(radiance[0]) * f64::from(wi.y) / pdf.max(f64::MIN_POSITIVE)
    });
    let off = (lit.mean - sun - cosine.mean).abs();
    assert!(off < MAX_SCORE * (lit.variance + cosine.variance).sqrt(), "{lit:?}, {cosine:?}, {sun}");
    let weighed = mean(42, |choice, u| {
        let sample = lights.sample(DVec3::ZERO, choice, u);
        let weight = |s: &LightSample| {
            let cosine = f64::from(s.wi.y) / PI;
            if s.is_delta { 1.0 } else { f64::from(s.pdf) / (f64::from(s.pdf) + cosine) }
        };
        let by_light = irradiance_of(sample, Vec3::Y) * sample.as_ref().map_or(0.0, weight);
        let (wi, pdf, radiance) = by_cosine(&lights, [u[1], u[0]]);
        by_light + f64::from(radiance[0]) * f64::from(wi.y) / (pdf + f64::from(lights.pdf(DVec3::ZERO, wi))).max(1e-300)
    });
    let off = (weighed.mean - lit.mean).abs();
    assert!(off < MAX_SCORE * (lit.variance + weighed.variance).sqrt(), "{lit:?}, {weighed:?}");
}

#[test]
fn a_sample_of_several_lights_carries_what_is_found_along_it() {
    let (lights, stream) = (several(), Stream::new(43, 0));
    let mut off = 0;
    for i in 0..20_000 {
        let Some(s) = lights.sample(DVec3::ZERO, stream.uniform(2 * i), stream.uniform_pair(2 * i + 1)) else {
            continue;
        };
        if !s.is_delta {
            let pdf = lights.pdf(DVec3::ZERO, s.wi);
            let found = lights.emitted(DVec3::ZERO, s.wi, f64::INFINITY);
            off += u64::from((pdf / s.pdf - 1.0).abs() > 1e-5 || found != s.radiance);
        }
    }
    // Directions within an f32's rounding of a rim or a texel's border.
    assert!(off <= 5, "{off}");
}

#[test]
fn a_rectangle_hides_from_the_front_alone() {
    let lights = several();
    let up = |from: DVec3| lights.emitted(from, Vec3::Y, f64::INFINITY);
    assert_eq!(up(DVec3::new(0.3, 0.0, 0.0)), [4.0; 3]);
    assert_eq!(up(DVec3::new(0.3, 1.5, 0.0)), [1.0; 3]);
    assert_eq!(lights.emitted(DVec3::new(0.3, 0.0, 0.0), Vec3::Y, 0.999), [0.0; 3]);
    assert_eq!(lights.emitted(DVec3::new(0.3, 1.5, 0.0), -Vec3::Y, 1.0), [0.0; 3]);
    // A sun straight above the lower rectangle's shade.
    let sun = Light::Directional(DirectionalLight { direction: Vec3::Y, irradiance: [1.0; 3] });
    let shaded = Lights::new(vec![lights.as_slice()[0].clone(), sun]);
    let delta_seen = |from| (0..50).filter_map(|k| shaded.sample(from, k as f32 / 50.0, [0.5; 2])).any(|s| s.is_delta);
    assert!(!delta_seen(DVec3::new(0.3, 0.0, 0.0)) && delta_seen(DVec3::new(0.9, 0.0, 0.0)));
}

/// A cell of a histogram: directions with the solid angles they stand for.
type Cell = Vec<(Vec3, f64)>;

/// Fails where counts do not follow `probabilities`, which sum to 1; cells of fewer than five expected hits are pooled.
fn expect_counts(name: &str, counts: &[u64], probabilities: &[f64]) {
    let total: u64 = counts.iter().sum();
    let sum: f64 = probabilities.iter().sum();
    assert!((sum - 1.0).abs() < 2e-3, "{name}: the density integrates to {sum}");
    let (mut chi_square, mut cells, mut pool) = (0.0, 0, (0.0, 0.0));
    let mut add = |observed: f64, expected: f64| {
        chi_square += (observed - expected).powi(2) / expected;
        cells += 1;
    };
    for (&count, &probability) in counts.iter().zip(probabilities) {
        let expected = probability * total as f64;
        assert!(expected > 0.0 || count == 0, "{name}: a sample where the density is 0");
        match expected {
            5.0.. => add(count as f64, expected),
            _ => pool = (pool.0 + count as f64, pool.1 + expected),
        }
    }
    if pool.1 > 5.0 {
        add(pool.0, pool.1);
    }
    // Wilson and Hilferty: the cube root of χ²/k is nearly normal.
    let freedom = f64::from(cells - 1);
    let spread = 2.0 / (9.0 * freedom);
    let score = ((chi_square / freedom).cbrt() - (1.0 - spread)) / spread.sqrt();
    assert!(score < MAX_SCORE, "{name}: χ² {chi_square} over {freedom} degrees of freedom");
}

/// Counts `SAMPLES` draws by cell and holds them against the density, integrated over the cells.
fn expect_density(
    name: &str,
    cells: &[Cell],
    pdf: impl Fn(Vec3) -> f32,
    draw: impl Fn(f32, [f32; 2]) -> Option<usize>,
) {
    let stream = Stream::new(50, name.len() as u64);
    let mut counts = vec![0; cells.len()];
    for i in 0..SAMPLES {
        let cell = draw(stream.uniform(2 * i), stream.uniform_pair(2 * i + 1));
        counts[cell.unwrap_or_else(|| panic!("{name}: a draw without a cell"))] += 1;
    }
    let probability = |cell: &Cell| cell.iter().map(|&(w, solid_angle)| f64::from(pdf(w)) * solid_angle).sum();
    expect_counts(name, &counts, &cells.iter().map(probability).collect::<Vec<f64>>());
}

/// Cells over the upper hemisphere, equal in azimuth (from `start`) and in the angle from +y.
struct Dome {
    columns: usize,
    rows: usize,
    start: f64,
    /// Angle from +y at the lower rim of the last row, which the horizon may cut.
    bottom: f64,
}

impl Dome {
    fn cells(&self, nodes: usize) -> Vec<Cell> {
        let polar_step = self.bottom / self.rows as f64;
        let azimuth_step = TAU / self.columns as f64;
        let cell = |i: usize| {
            let (column, row) = (i % self.columns, i / self.columns);
            // Equal steps in y, which is an area-preserving coordinate, from rim to rim or to the horizon.
            let rim = |v: usize| (polar_step * v as f64).min(FRAC_PI_2).cos();
            let (top, step) = (rim(row), (rim(row) - rim(row + 1)) / nodes as f64);
            let node = |k: usize| {
                let y = top - step * ((k / nodes) as f64 + 0.5);
                let azimuth = self.start + azimuth_step * (column as f64 + ((k % nodes) as f64 + 0.5) / nodes as f64);
                (spherical([azimuth, y.acos()]), step * azimuth_step / nodes as f64)
            };
            (0..nodes * nodes).map(node).collect()
        };
        (0..self.rows * self.columns).map(cell).collect()
    }

    fn index(&self, w: Vec3) -> usize {
        let turn = (f64::from(w.x).atan2(f64::from(-w.z)) - self.start).rem_euclid(TAU) / TAU;
        let column = ((turn * self.columns as f64) as usize).min(self.columns - 1);
        let row = (f64::from(w.y).acos() / self.bottom * self.rows as f64) as usize;
        row.min(self.rows - 1) * self.columns + column
    }
}

#[test]
fn directions_of_distant_lights_follow_their_density() {
    let rotation = 0.7;
    for (name, light, dome, nodes) in [
        ("constant", constant(1.0), Dome { columns: 20, rows: 12, start: 0.0, bottom: FRAC_PI_2 }, 16),
        (
            "image",
            Light::Image(speckled([24, 12], rotation)),
            Dome { columns: 48, rows: 12, start: -PI - rotation, bottom: FRAC_PI_2 },
            4,
        ),
        (
            "cut image",
            Light::Image(speckled([14, 7], rotation)),
            Dome { columns: 28, rows: 8, start: -PI - rotation, bottom: PI * 4.0 / 7.0 },
            4,
        ),
    ] {
        let draw = |_, u| light.sample(DVec3::ZERO, u).map(|s| dome.index(s.wi));
        expect_density(name, &dome.cells(nodes), |w| light.pdf(DVec3::ZERO, w), draw);
    }
}

#[test]
fn directions_of_rectangles_follow_their_density() {
    let (x, z) = (DVec3::new(0.8, 0.6, 0.0), DVec3::Z);
    for (name, centre, half, from) in [
        ("before the middle", DVec3::ZERO, [0.5, 0.7], DVec3::new(0.3, -0.4, 0.0)),
        ("close", DVec3::ZERO, [2.0, 1.0], DVec3::new(0.06, -0.08, 0.3)),
        ("edge-on", DVec3::ZERO, [0.5, 0.5], DVec3::new(2.0, 1.45, 0.4)),
        ("far and tiny", DVec3::new(0.0, 300.0, 0.0), [0.1, 0.1], DVec3::ZERO),
    ] {
        let rectangle = AreaLight::new(centre, [x * half[0], z * half[1]], [1.0; 3]);
        let light = Light::Area(rectangle);
        let normal = x.cross(z);
        let (grid, nodes) = (12, 16);
        let cell = |i: usize| {
            let node = |k: usize| {
                let at = |cell: usize, node: usize| {
                    2.0 * (cell as f64 + (node as f64 + 0.5) / nodes as f64) / grid as f64 - 1.0
                };
                let place = centre + x * (half[0] * at(i % grid, k % nodes)) + z * (half[1] * at(i / grid, k / nodes));
                let to = place - from;
                let area = 4.0 * half[0] * half[1] / ((grid * nodes) as f64).powi(2);
                (to.normalize().as_vec3(), area * -to.normalize().dot(normal) / to.length_squared())
            };
            (0..nodes * nodes).map(node).collect()
        };
        let cells: Vec<Cell> = (0..grid * grid).map(cell).collect();
        let draw = |_, u| {
            let sample = light.sample(from, u)?;
            let place = from + sample.wi.as_dvec3() * sample.distance - centre;
            // Within the rounding of an f32 direction of the plane.
            assert!(place.dot(normal).abs() < 1e-6 * sample.distance, "{name}");
            let along =
                |axis: DVec3, half: f64| (((place.dot(axis) / half + 1.0) * 0.5 * grid as f64) as usize).min(grid - 1);
            Some(along(z, half[1]) * grid + along(x, half[0]))
        };
        expect_density(name, &cells, |w| light.pdf(from, w), draw);
    }
}

#[test]
fn directions_of_several_lights_follow_their_density() {
    let lights = Lights::new(several().as_slice().iter().filter(|light| !light.is_delta()).cloned().collect());
    let dome = Dome { columns: 16, rows: 8, start: 0.0, bottom: FRAC_PI_2 };
    let draw = |choice, u| lights.sample(DVec3::ZERO, choice, u).map(|s| dome.index(s.wi));
    // Rims of rectangles run through cells: the integral is off by the cells' nodes over their perimeter.
    expect_density("several", &dome.cells(80), |w| lights.pdf(DVec3::ZERO, w), draw);
}
