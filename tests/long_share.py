"""Tests marked ``long``: a seeded tenth of their cases in a plain run, every case with ``--long``.

A long job (many seeds, kill series, runs of thousands of seconds) is a parametrised test whose cases are small::

    @pytest.mark.long
    @pytest.mark.parametrize("seed", range(300))
    def test_random_pushes(seed): ...

A plain run takes a tenth of the cases of each such test, or one of as many as ``long(one_of=25)`` says; of fewer than that
it takes the first, so the shortest stands there. Long tests of a single case form one group, of which it takes a tenth as
well; ``long(by_turns=True)`` puts the first case of a costly series into this group. The choice is a fixed one: every run of
the same tests, on every worker, does the same.

Of all other tests those are slow that take 0.3 s or more: they are listed in ``slow.txt``. A plain run of the whole
suite takes a tenth of them, one with ``--slow``, of some files or with ``-k`` or ``-m`` all.
"""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path
from zlib import crc32

import pytest

from tests.collection import in_order

_SEED = 12
_ONE_OF = 10
_SLOW_S = 0.3
_SLOW = Path(__file__).with_name("slow.txt")
"""Names of slow tests, a line each, without their cases; ``--note-slow`` writes it."""
every_case = False
"""Whether ``--long`` is given, once pytest is configured."""
_spent_s: dict[str, float] = defaultdict(float)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="run every case of the tests marked 'long', not a seeded tenth")
    parser.addoption("--slow", action="store_true", help="run all slow tests (tests/slow.txt), not a seeded tenth")
    parser.addoption("--note-slow", action="store_true", help="run all slow tests, and write anew which these are")


def pytest_configure(config: pytest.Config) -> None:
    global every_case
    every_case, option = config.getoption("--long"), config.option
    # A worker of pytest-xdist has the options of its controller, and arguments in any case.
    if not hasattr(config, "workerinput"):
        chosen = config.args_source is config.ArgsSource.ARGS or option.keyword or option.markexpr
        option.slow = bool(option.slow or option.note_slow or every_case or chosen)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    _spent_s[report.nodeid] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    if session.config.getoption("--note-slow") and not hasattr(session.config, "workerinput"):
        slow = {name.partition("[")[0] for name, spent_s in _spent_s.items() if spent_s >= _SLOW_S}
        _SLOW.write_text("".join(f"{name}\n" for name in sorted(slow)))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    in_order(items)
    listed = set(_SLOW.read_text().splitlines()) if _SLOW.is_file() else set()
    for item in items:
        if item.nodeid.partition("[")[0] in listed:
            item.add_marker("slow")
    # What takes longest is begun first: workers take from each other's end, and the short tests there let none wait long.
    items.sort(key=lambda item: [item.get_closest_marker(name) is None for name in ("slow", "long")])
    left_out = set() if config.getoption("--long") else _left_out_of_long(items)
    if not config.getoption("--slow"):
        left_out |= {
            *_left_out([item for item in items if item.get_closest_marker("slow") and item not in left_out], _ONE_OF)
        }
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=list(left_out))


def _left_out_of_long(items: list[pytest.Item]) -> set[pytest.Item]:
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
    return left_out | {*_left_out(alone, _ONE_OF)}


def _left_out(group: list[pytest.Item], one_of: int) -> list[pytest.Item]:
    few = len(group) < one_of
    return group[1:] if few else sorted(group, key=_rank)[math.ceil(len(group) / one_of) :]


def _rank(item: pytest.Item) -> int:
    """A number that looks random and is the same everywhere: adding a case changes little of what is taken."""
    return crc32(f"{_SEED} {item.name}".encode())
