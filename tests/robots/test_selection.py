"""When the tests of published robots run, and that they do not pass where the robots are not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.robots import conftest
from tests.robots.vendors import vendor_path

TESTS = """
import pytest

@pytest.mark.robots
def test_robot(): ...

@pytest.mark.slow
def test_slow(): ...

def test_short(): ...
"""


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], {"test_slow", "test_short"}),
        (["-m", "not slow"], {"test_short"}),
        (["-m", "slow"], {"test_slow"}),
        (["-m", "not robots"], {"test_slow", "test_short"}),
        (["-m", "robots"], {"test_robot"}),
        (["-m", "robots or slow"], {"test_robot", "test_slow"}),
    ],
)
def test_robots_run_where_they_are_named(pytester, options, expected):
    folder = pytester.mkpydir("robots")
    (folder / "conftest.py").write_text(Path(conftest.__file__).read_text())
    (folder / "test_x.py").write_text(TESTS)
    pytester.makeini("[pytest]\nmarkers =\n  robots: robots\n  slow: slow")
    result = pytester.runpytest_inprocess("--collect-only", "-q", "-p", "no:cacheprovider", *options)
    assert {line.partition("::")[2] for line in result.outlines if "::" in line} == expected


@pytest.mark.parametrize(
    ("package", "told"),
    [
        ("no-such-robot", "no-such-robot is not installed: uv run --group robots"),
        ("numpy", r"numpy [\d.]+ has no robot\.xml"),
    ],
)
def test_a_robot_that_is_not_there_fails(package, told):
    with pytest.raises(pytest.fail.Exception, match=told):
        vendor_path(package, "robot.xml")
