//! Several lights as one: which to sample, and with which density a direction is proposed in all.

use glam::{DVec3, Vec3};

use super::{Light, LightSample};

/// Share of the choice that is made without regard to strength.
///
/// The strength of a light is that on a plane which faces it or on the base plane, not that on the facet that is lit. A
/// share of one half bounds what a wrong guess costs to twice the variance of a choice among equals.
const UNIFORM_SHARE: f64 = 0.5;

/// The lights of a scene.
///
/// An area light hides what lies behind it from a point in front of it. So a direction meets one distance and one
/// radiance, whichever light proposed it, and the density of the direction is that of all lights together.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    lights: Vec<Light>,
}

impl Lights {
    /// All of `lights`; the order changes nothing but which random number leads to which light.
    pub fn new(lights: Vec<Light>) -> Self {
        Self { lights }
    }

    /// The lights, in the order given.
    pub fn as_slice(&self) -> &[Light] {
        &self.lights
    }

    /// Whether no ray can meet any of the lights.
    pub fn are_all_delta(&self) -> bool {
        self.lights.iter().all(Light::is_delta)
    }

    /// A direction from which `from` is lit, of one light chosen by about what it gives there.
    ///
    /// `u_choice` and `u` are uniform in [0, 1). The radiance is what [`Lights::emitted`] finds along `wi`, the
    /// density is [`Lights::pdf`] there; of a delta light its own irradiance and the probability of choosing it.
    pub fn sample(&self, from: DVec3, u_choice: f32, u: [f32; 2]) -> Option<LightSample> {
        if let [light] = self.lights.as_slice() {
            return light.sample(from, u);
        }
        let weights = Weights::new(&self.lights, from);
        let chosen = weights.choose(&self.lights, u_choice)?;
        let sample = self.lights[chosen].sample(from, u)?;
        let own = weights.probability(&self.lights[chosen]);
        let hidden_by = self.nearest_area(from, sample.wi, sample.distance);
        if sample.is_delta {
            return hidden_by.is_none().then_some(LightSample { pdf: own as f32, ..sample });
        }
        let (distance, radiance) = match hidden_by {
            Some(nearer) => nearer,
            None if self.lights[chosen].is_distant() => (sample.distance, self.distant(sample.wi)),
            None => (sample.distance, sample.radiance),
        };
        let others = self.lights.iter().enumerate().filter(|&(k, _)| k != chosen);
        let other_pdf: f64 =
            others.map(|(_, light)| weights.probability(light) * f64::from(light.pdf(from, sample.wi))).sum();
        let pdf = (own * f64::from(sample.pdf) + other_pdf) as f32;
        Some(LightSample { distance, radiance, pdf, ..sample })
    }

    /// Density with which [`Lights::sample`] at `origin` proposes `direction`, 1/sr; delta lights have no part in it.
    pub fn pdf(&self, origin: DVec3, direction: Vec3) -> f32 {
        if let [light] = self.lights.as_slice() {
            return light.pdf(origin, direction);
        }
        let weights = Weights::new(&self.lights, origin);
        let share = |light: &Light| weights.probability(light) * f64::from(light.pdf(origin, direction));
        self.lights.iter().map(share).sum::<f64>() as f32
    }

    /// Radiance along `direction` from what lies nearer than `t_max` metres, RGB, W/(m² sr).
    ///
    /// The nearest area light whose front the ray meets before `t_max`; else, where `t_max` is infinite because the ray
    /// leaves the scene, the distant lights; else nothing.
    pub fn emitted(&self, origin: DVec3, direction: Vec3, t_max: f64) -> [f32; 3] {
        match self.nearest_area(origin, direction, t_max) {
            Some((_, radiance)) => radiance,
            None if t_max == f64::INFINITY => self.distant(direction),
            None => [0.0; 3],
        }
    }

    /// What a ray meets of the lights if nothing else is there: metres (infinite for distant lights) and radiance.
    pub fn met(&self, origin: DVec3, direction: Vec3) -> (f64, [f32; 3]) {
        let near = self.nearest_area(origin, direction, f64::INFINITY);
        near.unwrap_or_else(|| (f64::INFINITY, self.distant(direction)))
    }

    /// The nearest area light before `t_max`: metres and radiance.
    fn nearest_area(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<(f64, [f32; 3])> {
        let near = self.lights.iter().filter(|light| !light.is_distant());
        near.filter_map(|light| light.emitted(origin, direction))
            .filter(|&(distance, _)| distance < t_max)
            .min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Radiance of all distant lights that are no delta lights.
    fn distant(&self, direction: Vec3) -> [f32; 3] {
        let distant = self.lights.iter().filter(|light| light.is_distant());
        distant
            .filter_map(|light| light.emitted(DVec3::ZERO, direction))
            .fold([0.0; 3], |sum, (_, radiance)| std::array::from_fn(|c| sum[c] + radiance[c]))
    }
}

/// What the choice among lights at a place goes by.
struct Weights {
    from: DVec3,
    /// Σ of the strengths.
    total: f64,
    /// Lights that give anything here.
    count: f64,
}

impl Weights {
    fn new(lights: &[Light], from: DVec3) -> Self {
        let strengths = lights.iter().map(|light| light.strength(from));
        let (total, count) = strengths.fold((0.0, 0.0), |(total, count), strength| {
            (total + strength, if strength > 0.0 { count + 1.0 } else { count })
        });
        Self { from, total, count }
    }

    /// Probability of choosing `light`; 0 where it gives nothing.
    fn probability(&self, light: &Light) -> f64 {
        let strength = light.strength(self.from);
        if strength > 0.0 { UNIFORM_SHARE / self.count + (1.0 - UNIFORM_SHARE) * strength / self.total } else { 0.0 }
    }

    /// Index of the light that `u` leads to; `None` if none gives anything.
    fn choose(&self, lights: &[Light], u: f32) -> Option<usize> {
        let mut left = f64::from(u);
        let mut last = None;
        for (k, light) in lights.iter().enumerate() {
            let probability = self.probability(light);
            if probability > 0.0 {
                // The last one also takes what rounding leaves over.
                last = Some(k);
                if left < probability {
                    break;
                }
                left -= probability;
            }
        }
        last
    }
}
