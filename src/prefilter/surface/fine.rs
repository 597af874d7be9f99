//! F of the fine surface on the table directions, from all texels.
