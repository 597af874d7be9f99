//! Light in volumes against closed forms and brute force.

mod prefilter;
mod scenes;
mod transport;
