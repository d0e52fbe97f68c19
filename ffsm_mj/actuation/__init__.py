"""Actuation: limits of actuators, on-off valves, and the error of a step under held efforts."""
