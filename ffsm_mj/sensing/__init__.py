"""Sensors: what a robot measures, with its errors and delays, from the true state."""
