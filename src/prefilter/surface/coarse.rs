//! F of the coarse surface on the table directions, from all cells.
