"""Grasps: an object is captured, rigidly attached to a link of the robot, and released."""
