//! The von Mises-Fisher distribution on the sphere, in forms that hold from κ = 0 to 1e6.
