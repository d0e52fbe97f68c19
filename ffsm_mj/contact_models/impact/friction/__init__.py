"""Coulomb friction at impacts, without energy gain: pure mathematics in mass-weighted velocities."""
