"""Fixtures of the tests of logs."""

from __future__ import annotations

import pytest

import ffsm_mj
from ffsm_mj.records import kinds as register_of_kinds
from ffsm_mj.records.kinds import register
from tests.log.grips import GRIP
from tests.scenes import two_balls


@pytest.fixture
def grips(monkeypatch):
    """The kind of record of grips, registered for one test."""
    monkeypatch.setattr(register_of_kinds, "_KNOWN", dict(register_of_kinds._KNOWN))
    register(GRIP)


@pytest.fixture(scope="module")
def plain_run(tmp_path_factory):
    """A run with one impact, at 0.3 s, without grips."""
    return ffsm_mj.run(two_balls(tmp_path_factory.mktemp("plain"), duration_s=0.5))
