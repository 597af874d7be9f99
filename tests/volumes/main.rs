//! Light in volumes against closed forms and brute force.

mod scenes;
mod transport;
