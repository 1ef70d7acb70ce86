"""A whole body: one sparse model, a coarse shape, a plan of overlapping tiles, their maps, and one closed surface."""
