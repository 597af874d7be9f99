//! The walk of light among flakes: fly, meet a voxel, scatter; and when it is no longer worth to go on.

use glam::{DVec3, Vec3};

use crate::math::rng::Draws;
use crate::medium::{BoundFlakes, Flight, MAX_LOBES, Medium, Place};

/// Largest throughput under which a walk goes on by Russian roulette.
///
/// Variance times cost of a mean in constant light (bench `volume`), against ½: 1.05 to 1.1 at ¼, 1.2 to 1.3 at 1.
const ROULETTE: f32 = 0.5;

/// Scatterings after which a walk of albedo 1 in a medium that it cannot leave is given up: a guard, not an estimate.
const MAX_SCATTERINGS: u32 = 1 << 16;

/// A walk under way, from a place along a direction.
#[derive(Clone, Debug)]
pub struct Walk<'m> {
    medium: &'m Medium,
    place: Place,
    /// Along the flight, unit, frame of the grid.
    pub direction: Vec3,
    /// Metres, frame of the grid, not wrapped.
    pub point: DVec3,
    /// Product of the weights so far, RGB.
    pub throughput: Vec3,
    /// Product of one over the chances to survive roulette.
    pub survival: f32,
    scatterings: u32,
}

/// Flakes that a walk meets.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    /// Index of the occupied voxel.
    pub voxel: usize,
    /// Metres flown to it.
    pub distance: f64,
    /// Its flakes as seen from where the walk comes from.
    pub flakes: BoundFlakes,
}

impl<'m> Walk<'m> {
    /// A walk along the ray from `origin` (metres) in `direction` (unit); `None` where the ray misses the grid.
    pub fn enter(medium: &'m Medium, origin: DVec3, direction: DVec3) -> Option<Self> {
        let (place, t) = medium.enter(origin, direction)?;
        let point = origin + t * direction;
        let direction = direction.as_vec3().normalize();
        Some(Self { medium, place, direction, point, throughput: Vec3::ONE, survival: 1.0, scatterings: 0 })
    }

    /// Flies to the next flakes; `None` where the walk leaves the medium.
    #[inline]
    pub fn fly(&mut self, draws: &mut Draws) -> Option<Meeting> {
        let Flight::Collision { place, voxel, distance } = self.medium.fly(self.place, self.direction, draws) else {
            return None;
        };
        self.place = place;
        self.point += distance * self.direction.as_dvec3();
        Some(Meeting { voxel, distance, flakes: self.medium.flakes(voxel, -self.direction) })
    }

    /// Scatters at `meeting`: throughput and direction change. Returns the share of each lobe, and the density of the new
    /// direction is [`BoundFlakes::pdf`] there.
    #[inline]
    pub fn scatter(&mut self, meeting: &Meeting, draws: &mut Draws) -> [f32; MAX_LOBES] {
        let scatter = meeting.flakes.sample(draws.pair());
        self.direction = scatter.wi;
        self.throughput *= Vec3::from(scatter.weight);
        self.scatterings += 1;
        scatter.posterior
    }

    /// Whether the walk goes on; a survivor's throughput is raised by one over its chance.
    #[inline]
    pub fn survives(&mut self, draws: &mut Draws) -> bool {
        let largest = self.throughput.max_element();
        if largest >= ROULETTE {
            return self.scatterings < MAX_SCATTERINGS;
        }
        // towards the throughput at which roulette began
        let chance = largest / ROULETTE;
        if draws.uniform() >= chance {
            return false;
        }
        self.throughput /= chance;
        self.survival /= chance;
        self.scatterings < MAX_SCATTERINGS
    }

    /// The transmittance from here along `direction` (unit, frame of the grid) over `reach` metres.
    #[inline]
    pub fn transmittance(&self, direction: Vec3, reach: f64) -> f32 {
        self.medium.transmittance(self.place, direction, reach)
    }
}
