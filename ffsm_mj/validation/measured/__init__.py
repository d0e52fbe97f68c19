"""Measured impacts beside computed ones: data sets of others, read from a user's copy and never shipped."""
