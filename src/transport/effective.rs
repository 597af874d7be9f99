//! The effective BRDF of a patch, by exact ray casts.
