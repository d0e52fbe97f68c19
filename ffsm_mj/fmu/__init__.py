"""Scenarios as functional mock-up units (FMI 2.0, co-simulation), for masters that couple simulators by the standard."""
