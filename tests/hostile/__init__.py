"""Hostile input: seeded mutations of the shipped scenarios, models and logs, and what a command may answer to them."""
