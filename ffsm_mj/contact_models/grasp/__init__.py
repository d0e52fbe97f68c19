"""Capture: an object is grasped, held as a part of the robot, and let go."""
