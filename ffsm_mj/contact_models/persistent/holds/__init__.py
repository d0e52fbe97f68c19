"""Contact points that are held inside a step, as conditions on the relative twists of their bodies."""
