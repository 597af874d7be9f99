//! Normal distributions of cells as mixtures of von Mises-Fisher lobes.
