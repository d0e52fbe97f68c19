"""Detumbling: the angular momentum of robot and grasped object into wheels, or out by thrusters."""
