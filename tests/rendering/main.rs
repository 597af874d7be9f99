//! The renderer against radiance that is known on paper.

mod furnace;
mod groove;
mod known_radiance;
mod levels;
mod light_types;
mod repeatability;
mod scenes;
mod statistics;
mod stored;
