"""Contact geometry: pairs of geoms with gap, normal, contact points and rates; contact features; unhandled contacts."""
