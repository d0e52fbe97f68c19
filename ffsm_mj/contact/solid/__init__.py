"""Static geometry of the union of the convex pieces of one rigid body."""
