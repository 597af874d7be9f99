//! Light reflected more than once: F of the compiler, F by exact paths, the renderer, and the white furnace.

mod support;

use farfield::build::key::Digest;
use farfield::build::{Input, ModelData};
use farfield::geometry::{Boundary, HeightField, HeightTracer};
use farfield::material::{Brdf, Conductor};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::reflectance::{PatchReflectance, TableDirections, pair};
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport, ReflectionBound, reflectance};
use farfield::transport::bounces::{BaseReflector, bounce};
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::effective::{base_scatter, for_each_point};
use farfield::transport::film::Film;
use farfield::transport::light::{ConstantLight, DirectionalLight, Light, Lights};
use farfield::transport::render::{Integrator, RenderSettings, render};
use farfield::transport::sampler::Sampling;
use farfield::transport::scene::{Lod, Scene};
use farfield::transport::{Accumulator, Estimate, PatchSampling};
use formats::asset::SurfaceAsset;
use glam::{DVec3, Vec3};
use support::{
    COS_75, at, compiled, diffuse, field, fixture, level_reflectance, measured, through_bytes, towards, waves,
};

/// Diffuse and glossy, coloured: three channels that differ.
const COLOURED: Brdf = Brdf { diffuse: [0.5, 0.3, 0.1], specular: Some(Conductor::ggx(0.3, [0.8, 0.5, 0.2])) };

fn baked() -> LevelSettings {
    LevelSettings { light: LightTransport::Baked, ..at(8.0) }
}

/// F of the whole map on the table directions: of direct light, and of light reflected twice or more.
fn tables(fine: &FineSurface, directions: &TableDirections) -> [PatchReflectance; 2] {
    let (direct, more) = reflectance(fine, [1, 1], directions, &baked());
    [direct, more.reflectance]
}

/// F of the whole map for a pair of directions, all light, by exact ray casts.
fn exact(fine: &FineSurface, [wi, wo]: [Vec3; 2], strata: usize) -> [Estimate; 3] {
    let tracer = HeightTracer::new(&fine.heights);
    let sampling = PatchSampling::of_grid([1, 1], 0, strata, 5);
    let width = fine.heights.size()[0];
    let reflector = BaseReflector { brdf: &fine.brdf, color: fine.color.as_deref(), width };
    let paths = Stream::new(5, 77);
    let mut sums = [Accumulator::default(); 3];
    for_each_point(&tracer, &sampling, &[wi, wo], |point| {
        let mut value = [0.0; 3];
        if point.sees(0) && point.sees(1) {
            let [u, v] = point.point.cell;
            let brdf = fine.color.as_ref().map_or(fine.brdf, |color| fine.brdf.tinted(color[v * width + u]));
            value = base_scatter(&brdf, point.normal, wi, wo).map(f64::from);
        }
        if let Some(path) = bounce(&tracer, &reflector, point, &[wi, wo], paths.at((point.stratum as u64) << 20)) {
            let reflected = path.reflected(0, 1);
            (0..3).for_each(|c| value[c] += reflected[c]);
        }
        (0..3).for_each(|c| sums[c].add(value[c]));
    });
    sums.map(|sum| sum.estimate())
}

/// Hills of 128² with slopes up to 2.
fn hills() -> HeightField {
    field([128, 128], [1.0; 2], Boundary::Repeat, waves([128, 128], 16.0, 3.0, 6))
}

#[test]
fn the_compilers_f_is_that_of_exact_paths() {
    let fine = FineSurface { heights: hills(), brdf: COLOURED, color: None };
    let directions = TableDirections::new(15);
    let [direct, more] = tables(&fine, &directions);
    let stream = Stream::new(3, 3);
    let mut squares = [0.0; 2];
    for k in 0..24 {
        let [i, o] = [0, 1].map(|d| (stream.uniform(2 * k + d) * 225.0) as usize);
        let [wi, wo] = [i, o].map(|d| Vec3::from(directions.vectors[d]));
        if wi.z < COS_75 || wo.z < COS_75 {
            continue;
        }
        let expected = exact(&fine, [wi, wo], 256);
        for (c, expected) in expected.iter().enumerate() {
            let k = pair(i.max(o), i.min(o));
            let found = f64::from(direct.channel(0, c)[k] + more.channel(0, c)[k]);
            squares[0] += (found - expected.mean).powi(2) - expected.variance;
            squares[1] += expected.mean.powi(2);
        }
    }
    // visibility by bits, bins of normals, and 0.3 % of noise on the table's side
    let error = (squares[0].max(0.0) / squares[1]).sqrt();
    println!("root mean square over pairs: {:.2} %", 100.0 * error);
    assert!(error < 0.01, "{error}");
}

#[test]
fn exact_paths_reflect_what_the_renderer_shows() {
    let fine = FineSurface { heights: hills(), brdf: COLOURED, color: None };
    let extent = fine.heights.extent().map(f64::from);
    let [wi, wo] = [towards(0.9, 2.0), towards(60_f32.to_radians(), 0.0)];
    let f = exact(&fine, [wi, wo], 768);
    // world: x, height, −y. The film covers four whole tiles along either side: 60° halve its height.
    let world = |w: Vec3| DVec3::new(f64::from(w.x), f64::from(w.z), f64::from(-w.y));
    let projection = Projection::Orthographic { width: 4.0 * extent[1] };
    let camera = Camera::look_at(world(wo) * 2000.0, DVec3::ZERO, DVec3::Y, projection, [128, 64]).expect("a view");
    let light = DirectionalLight { direction: world(wi).as_vec3(), irradiance: [1.0; 3] };
    let input = Input { fine, height_digest: Digest::of(b""), color_digest: None, warnings: Vec::new() };
    let data = ModelData::full(&input);
    let scene =
        Scene { camera, lights: Lights::new(vec![Light::Directional(light)]), surface: data.object([40, 40], None) };
    let settings =
        RenderSettings { integrator: Integrator::Path, lod: Lod::Fixed(0), seed: 4, sampling: Sampling::Independent };
    let mut film = Film::new(scene.camera.size());
    render(&scene, &settings, 0..128, &mut film);
    let (radiance, variance) = (film.radiance(), film.variance());
    let n = radiance.len() as f64;
    for c in 0..3 {
        let mean = radiance.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / n;
        let squared = variance.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / (n * n);
        // F = A·L with A = cos θo, whatever the relief
        let (cos, deviation) = (f64::from(wo.z), (squared * f64::from(wo.z).powi(2) + f[c].variance).sqrt());
        let z = (mean * cos - f[c].mean) / deviation;
        println!("channel {c}: renderer {:.5}, exact {:.5}, z {z:+.2}", mean * cos, f[c].mean);
        assert!(z.abs() < 4.0, "channel {c}: {} and {:?}", mean * cos, f[c]);
    }
}

/// Effective albedo of the map towards the direction `o`: ∫ F dωi over cos θo, the quadrature normalised by the plane's.
fn albedo(f: &PatchReflectance, directions: &TableDirections, o: usize) -> f64 {
    let sum: f64 = (0..directions.len()).map(|i| f64::from(f.channel(0, 0)[pair(i.max(o), i.min(o))])).sum();
    let plane: f64 = directions.vectors.iter().map(|w| f64::from(w[2])).sum();
    sum * std::f64::consts::PI / plane / f64::from(directions.vectors[o][2])
}

#[test]
fn a_white_surface_loses_no_light() {
    let directions = TableDirections::new(15);
    for (name, amplitude) in [("heights/twill", 24.415), ("heights/vgroove", 32.0), ("heights/bump", 28.0)] {
        let fine = FineSurface { heights: fixture(name, amplitude), brdf: diffuse(1.0), color: None };
        let [direct, more] = tables(&fine, &directions);
        let below: Vec<usize> = (0..225).filter(|&o| directions.vectors[o][2] > COS_75).collect();
        let mean =
            |f: &PatchReflectance| below.iter().map(|&o| albedo(f, &directions, o)).sum::<f64>() / below.len() as f64;
        let direct = mean(&direct);
        let all = direct + mean(&more);
        println!("{name}: effective albedo {all:.4}, of direct light alone {direct:.4}");
        assert!(direct < 0.9, "{name}: direct light alone is not all: {direct}");
        assert!((all - 1.0).abs() < 0.005, "{name}: {all}");
    }
}

#[test]
fn a_flat_surface_has_no_interreflection() {
    let fine =
        FineSurface { heights: field([32, 32], [1.0; 2], Boundary::Repeat, |_, _| 0.3), brdf: COLOURED, color: None };
    let directions = TableDirections::new(7);
    let [_, more] = tables(&fine, &directions);
    for c in 0..3 {
        assert!(more.channel(0, c).iter().all(|&f| f == 0.0));
    }
}

/// What the paths of the grooves aim at: an eighth of it is their noise.
const GROOVE_ERROR: f64 = 0.004;

/// Texels of a groove's wall along u.
const WALL: f32 = 64.0;

/// Grooves of 45°, [`WALL`] texels from ridge to bottom along u, of a grey Lambertian, and their level at 4×.
fn grooves() -> (FineSurface, SurfaceAsset) {
    let heights = field([256, 32], [1.0; 2], Boundary::Repeat, |i, _| (i as f32 % (2.0 * WALL) - WALL).abs());
    let fine = FineSurface { heights, brdf: diffuse(0.8), color: None };
    let settings = LevelSettings { factor: 4.0, patches: Some(1), error: GROOVE_ERROR, ..baked() };
    let mut asset = through_bytes(&fine, compiled(&fine, &settings));
    asset.light = formats::asset::Light::Baked;
    (fine, asset)
}

/// Mean and standard error of the green channel over whole grooves of a level, seen from `wo`.
fn rendered(asset: SurfaceAsset, light: Light, wo: Vec3, integrator: Integrator, samples: u64) -> [f64; 2] {
    let data = ModelData::farfield(asset);
    let world = |w: Vec3| DVec3::new(f64::from(w.x), f64::from(w.z), f64::from(-w.y));
    // the film lies along x, in which the view leans: its height covers 1/cos of itself
    let up = DVec3::new(-f64::from(wo.z), f64::from(wo.x), 0.0);
    let projection = Projection::Orthographic { width: 512.0 * f64::from(wo.z) };
    let camera = Camera::look_at(world(wo) * 5000.0, DVec3::ZERO, up, projection, [64, 64]).expect("a view");
    let scene = Scene { camera, lights: Lights::new(vec![light]), surface: data.object([40, 40], None) };
    let settings = RenderSettings { integrator, lod: Lod::Fixed(0), seed: 4, sampling: Sampling::Independent };
    let mut film = Film::new(scene.camera.size());
    render(&scene, &settings, 0..samples, &mut film);
    let (radiance, variance) = (film.radiance(), film.variance());
    let n = radiance.len() as f64;
    let squared = variance.iter().map(|rgb| f64::from(rgb[1])).sum::<f64>() / (n * n);
    [radiance.iter().map(|rgb| f64::from(rgb[1])).sum::<f64>() / n, squared.sqrt()]
}

#[test]
fn a_shadowed_wall_shows_the_light_of_the_other() {
    // 61.9° from either side, nodes of E: no wall sees both light and viewer, all that is seen was reflected twice or more
    let (fine, asset) = grooves();
    assert_eq!(asset.levels[0].additive.as_ref().map(|term| term.directions), Some(11));
    let [wi, wo] = [9.5, 1.5].map(|column| Vec3::from(formats::lookup::direction_of([column / 11.0, 0.5])));
    let f = exact(&fine, [wi, wo], 512)[1];
    let world = Vec3::new(wi.x, wi.z, -wi.y);
    let sun = Light::Directional(DirectionalLight { direction: world, irradiance: [1.0; 3] });
    let [mean, error] = rendered(asset.clone(), sun.clone(), wo, Integrator::Direct, 64);
    // F = A·L with A = cos θo
    let (found, error) = (mean * f64::from(wo.z), error * f64::from(wo.z));
    println!("level {found:.5} ± {error:.5}, original {:.5} ± {:.5}", f.mean, f.standard_error());
    // the paths' noise is a root mean square over pairs, relative to that of F: that of a flat plane, 0.8/π cosθi cosθo,
    // is ⅓·0.8/π. Half floats keep E and T_a within 5e-4 each. The edge of the shadow at the bottom of a wall lies up to
    // half a texel off where bits see it, once for the light and once for the viewer
    let noise = GROOVE_ERROR / 8.0 * 0.8 * std::f64::consts::FRAC_1_PI / 3.0;
    let allowed = 4.0 * (noise.powi(2) + f.variance + error * error).sqrt() + (1e-3 + 1.0 / f64::from(WALL)) * f.mean;
    assert!((found - f.mean).abs() < allowed, "{found}, wanted {} within {allowed}", f.mean);
    let mut without = asset;
    without.levels[0].additive = None;
    assert!(rendered(without, sun, wo, Integrator::Direct, 16)[0] < 0.02 * mean, "the scaling cannot make this light");
}

#[test]
fn two_coloured_grooves_keep_their_colour_under_a_moving_light() {
    let (mut fine, _) = grooves();
    let [warm, cold] = [[1.0, 0.5, 0.25], [0.25, 0.5, 1.0]];
    let side = |k: usize| if (k % 256) as f32 % (2.0 * WALL) < WALL { warm } else { cold };
    fine.color = Some((0..256 * 32).map(side).collect());
    let mut asset = through_bytes(&fine, compiled(&fine, &LevelSettings { factor: 4.0, patches: Some(1), ..baked() }));
    asset.light = formats::asset::Light::Baked;
    let share = |f: [f64; 3]| f.map(|x| x / f.iter().sum::<f64>());
    let (mut worst, mut shift) = (0.0_f64, [1.0_f64, 0.0]);
    for degrees in [-65.0_f32, -50.0, -35.0, -20.0, -5.0, 10.0, 25.0, 40.0, 55.0, 70.0] {
        for view in [towards(0.0, 0.0), towards(0.6, 0.4)] {
            let wi = towards(degrees.to_radians(), 0.1);
            let estimate = exact(&fine, [wi, view], 256);
            let (wanted, found) = (share(estimate.map(|f| f.mean)), share(level_reflectance(&asset, [wi, view], 128)));
            let off = (0..3).map(|c| (found[c] / wanted[c] - 1.0).abs()).fold(0.0, f64::max);
            println!("light {degrees}°: {wanted:.4?}, level {found:.4?}, {:.2} % off", 100.0 * off);
            worst = worst.max(off);
            shift = [shift[0].min(wanted[0]), shift[1].max(wanted[0])];
        }
    }
    println!(
        "red is {:.3} to {:.3} of the light; the level's colours are within {:.2} %",
        shift[0],
        shift[1],
        100.0 * worst
    );
    assert!(shift[1] > 2.0 * shift[0], "a light that moves shows one side, then the other: {shift:?}");
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn the_bound_of_interreflection_is_one_and_lets_it_be_skipped() {
    let directions = TableDirections::new(7);
    for (rms, albedo) in [(0.1, 1.0), (0.4, 0.9), (1.0, 0.5)] {
        let heights = field([64, 64], [1.0; 2], Boundary::Repeat, waves([64, 64], 16.0, rms, 9));
        let fine = FineSurface { heights, brdf: diffuse(albedo), color: None };
        let bound = ReflectionBound::new(&fine).expect("a Lambertian base has one");
        let (_, more) = reflectance(&fine, [1, 1], &directions, &baked());
        let mut most = 0.0_f32;
        for (i, o) in (0..49).flat_map(|i| (0..=i).map(move |o| (i, o))) {
            let allowed = bound.between(directions.vectors[i], directions.vectors[o])[0];
            most = most.max(more.reflectance.channel(0, 0)[pair(i, o)] / allowed);
        }
        println!("rms {rms}, albedo {albedo}: at most {most:.3} of the bound");
        assert!(most > 0.0 && most <= 1.0, "{most}");
    }
    // 1 % of slope: a hidden share of 1.5e-4; at 20 % the bound is far above any error
    for (slope, skipped) in [(0.01, true), (0.2, false)] {
        let heights = field([64, 64], [1.0; 2], Boundary::Repeat, |i, _| slope * (i as f32 - 32.0).abs());
        let fine = FineSurface { heights, brdf: diffuse(0.5), color: None };
        let level = compiled(&fine, &LevelSettings { directions: Some(7), patches: Some(1), ..baked() });
        assert_eq!((level.skipped_interreflection.is_some(), level.additive.is_none()), (skipped, skipped));
    }
}

#[test]
fn the_additive_term_alone_is_a_brdf_of_the_base_plane() {
    let (_, mut asset) = grooves();
    let level = &mut asset.levels[0];
    level.angular.iter_mut().flatten().for_each(|s| *s = [0.0; 3]);
    let term = level.additive.as_mut().expect("a baked level has one");
    term.spatial.fill([1.0; 3]);
    term.angular.fill([0.2; 3]);
    let direction = Vec3::new(0.6, 0.8, 0.0);
    let sun = Light::Directional(DirectionalLight { direction, irradiance: [1.0; 3] });
    let sky = Light::Constant(ConstantLight { radiance: [1.0; 3] });
    for (light, expected) in [(sun, 0.2 * 0.8), (sky, 0.2 * std::f64::consts::PI)] {
        for integrator in [Integrator::Direct, Integrator::Path] {
            for degrees in [0.0_f32, 60.0] {
                let [mean, error] =
                    rendered(asset.clone(), light.clone(), towards(degrees.to_radians(), 0.0), integrator, 64);
                assert!(
                    (mean - expected).abs() < 4.5 * error + 1e-5,
                    "{degrees}°, {integrator:?}: {mean} ± {error}, {expected}"
                );
            }
        }
    }
}

#[test]
fn a_baked_level_reads_as_the_original_with_interreflection() {
    let fine = FineSurface { heights: hills(), brdf: diffuse(0.8), color: None };
    let mut asset = through_bytes(&fine, compiled(&fine, &LevelSettings { patches: Some(2), ..baked() }));
    let as_direct = measured(&fine, &asset, 7);
    asset.light = formats::asset::Light::Baked;
    let error = measured(&fine, &asset, 7);
    println!("ε {:?}, bias {:?}; judged as direct light {:?}", error.below_75, error.bias, as_direct.bias);
    assert!(error.below_75.value < 0.04, "{:?}", error.below_75);
    assert!(error.bias.value.abs() < 0.01 + 3.0 * error.bias.standard_error, "{:?}", error.bias);
    // with an albedo of 0.8 a tenth and more of the light has been reflected before
    assert!(as_direct.bias.value > 0.1, "{:?}", as_direct.bias);
}
