"""Contact features: the vertex, edge, face and curve pairs by which two geoms touch, and their gap functions."""
