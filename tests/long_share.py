"""Tests marked ``long``: a seeded tenth of their cases in a plain run, every case with ``--long``.

A long job (many seeds, kill series, runs of thousands of seconds) is a parametrised test whose cases are small::

    @pytest.mark.long
    @pytest.mark.parametrize("seed", range(300))
    def test_random_pushes(seed): ...

A plain run takes a tenth of the cases of each such test, or one of as many as ``long(one_of=25)`` says; of fewer than that
it takes the first, so the shortest stands there. Long tests of a single case form one group, of which it takes a tenth as
well; ``long(by_turns=True)`` puts the first case of a costly series into this group. The choice is a fixed one: every run of
the same tests, on every worker, does the same.
"""

from __future__ import annotations

import math
from collections import defaultdict
from zlib import crc32

import pytest

from tests.collection import in_order

_SEED = 12
_ONE_OF = 10
every_case = False
"""Whether ``--long`` is given, once pytest is configured."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="run every case of the tests marked 'long', not a seeded tenth")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    in_order(items)
    # What takes longest is begun first: workers take from each other's end, and the short tests there let none wait long.
    items.sort(key=lambda item: [item.get_closest_marker(name) is None for name in ("slow", "long")])
    if config.getoption("--long"):
        return
    groups, alone = defaultdict(list), []
    for item in items:
        if item.get_closest_marker("long"):
            (groups[item.nodeid.partition("[")[0]] if hasattr(item, "callspec") else alone).append(item)
    left_out: set[pytest.Item] = set()
    for group in groups.values():
        options = group[0].get_closest_marker("long").kwargs
        if options.get("by_turns"):
            alone.append(group[0])
            left_out |= {*group[1:]}
        else:
            left_out |= {*_left_out(group, options.get("one_of", _ONE_OF))}
    left_out |= {*_left_out(alone, _ONE_OF)}
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=list(left_out))


def _left_out(group: list[pytest.Item], one_of: int) -> list[pytest.Item]:
    few = len(group) < one_of
    return group[1:] if few else sorted(group, key=_rank)[math.ceil(len(group) / one_of) :]


def _rank(item: pytest.Item) -> int:
    """A number that looks random and is the same everywhere: adding a case changes little of what is taken."""
    return crc32(f"{_SEED} {item.name}".encode())
