//! Counter-based random numbers: a function of (seed, stream, index), never of a thread.
