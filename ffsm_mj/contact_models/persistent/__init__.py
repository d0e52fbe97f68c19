"""Persistent contact: pushing, resting and frictionless sliding, as exact constraints at the acceleration level."""
