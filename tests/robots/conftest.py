"""Tests marked ``robots`` need a dependency group of their own, so they run where ``-m`` names them and nowhere else."""

from __future__ import annotations

import re

import pytest


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if re.search(r"\brobots\b", config.option.markexpr):
        return
    left_out = [item for item in items if item.get_closest_marker("robots")]
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=left_out)
