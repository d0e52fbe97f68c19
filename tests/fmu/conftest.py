"""Runs of units are closed: masters free their instances when it suits them, and an open simulator handles signals."""

from __future__ import annotations

import pytest

from ffsm_mj.fmu.co_simulation import CoSimulation


@pytest.fixture(autouse=True)
def closed_runs(monkeypatch):
    """Close what a test has begun, by whatever master."""
    begun, begin = [], CoSimulation.__init__

    def noting(self, *arguments):
        begun.append(self)
        begin(self, *arguments)

    monkeypatch.setattr(CoSimulation, "__init__", noting)
    yield
    for one in begun:
        one.close()
