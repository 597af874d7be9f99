//! Coarse heights whose cells keep the mean slopes of the fine surface.
