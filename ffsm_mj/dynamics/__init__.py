"""Smooth motion: steps of free flight, and a step as a path."""
