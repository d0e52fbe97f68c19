"""Workers of pytest-xdist collect from opposite ends of the tests.

On a fresh checkout the assertions of every module are rewritten, which takes as long as 5 % of the suite; what one worker
has rewritten the other reads, and so each does half of it.

Modules and tests stay to the end: the garbage collector does not go through them again and again, which took a tenth of the
suite.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Iterator[None]:
    report = yield
    worker = getattr(collector.config, "workerinput", {}).get("workerid", "gw0")
    if int(worker.removeprefix("gw")) % 2 and isinstance(collector, pytest.Directory | pytest.Session):
        report.result.reverse()
    return report


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


def in_order(items: list[pytest.Item]) -> None:
    """Sort tests as if every worker had collected from the same end."""
    items.sort(key=lambda item: item.path.parts)
