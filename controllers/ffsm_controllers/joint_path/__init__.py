"""Motion of joints through waypoints."""
