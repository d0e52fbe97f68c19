"""External fields: forces and torques on every body from outside the system; orbits."""
