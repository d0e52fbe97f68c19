"""The loads of these scenes are known in all of these tests."""

from __future__ import annotations

import pytest

from ffsm_mj.contact_models import registry
from tests.contact_models.persistent.friction.scenes import Loads


@pytest.fixture(autouse=True)
def known_loads(example_contact_models):  # noqa: ARG001
    """Registered for one test at a time."""
    registry.register(Loads)
