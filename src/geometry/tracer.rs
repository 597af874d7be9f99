//! Exact rays against a bilinear height field: a min/max quadtree over its cells.
