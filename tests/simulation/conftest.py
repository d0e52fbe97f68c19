"""Fixtures of these tests."""

from tests.simulators import closed_simulators  # noqa: F401
