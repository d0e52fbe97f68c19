"""Decomposition of meshes that are not convex into convex pieces: the gate, the methods, what is stored of the result."""
