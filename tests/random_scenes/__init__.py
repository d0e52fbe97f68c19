"""Random scenes of all features together: a seed gives a scene, and run, checks, log replay and an oracle must agree on it.

``uv run python -m tests.random_scenes 0 300 --jobs 2`` runs a range of seeds and groups what differs by its cause.
"""
