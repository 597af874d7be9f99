//! A Monte Carlo result: mean, variance of the mean, sample count.
