"""Pairs of geoms that may touch: gap, normal, points, rates; and the watch over all other pairs."""
