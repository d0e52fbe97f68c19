"""Comparison of all that ships with another revision of the repository."""
