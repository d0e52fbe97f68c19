"""Simulators of tests, which are closed after each test: one with a run holds handlers of the process."""

from __future__ import annotations

import pytest

from ffsm_mj.assembly.simulator import Simulator


@pytest.fixture(autouse=True)
def closed_simulators(monkeypatch):
    begun, begin = [], Simulator._begin

    def noted(self, *args, **options):
        begun.append(self)
        return begin(self, *args, **options)

    monkeypatch.setattr(Simulator, "_begin", noted)
    yield
    for simulator in begun:
        simulator.close()
