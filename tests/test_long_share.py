"""What a plain run takes of long tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import long_share

TESTS = """
import pytest

@pytest.mark.long
@pytest.mark.parametrize("seed", range(45))
def test_seeds(seed): ...

@pytest.mark.long
@pytest.mark.parametrize("case", "abc")
def test_few(case): ...

@pytest.mark.long(one_of=25)
@pytest.mark.parametrize("seed", range(50))
def test_costly(seed): ...

@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("seed", range(30))
def test_turns(seed): ...

@pytest.mark.long
def test_alone(): ...

@pytest.mark.long
def test_alone_too(): ...

def test_short(): ...

@pytest.mark.parametrize("case", range(20))
def test_slow(case): ...
"""
SLOW = "test_x.py::test_slow\n"
CASES = """
import time

import pytest

@pytest.mark.parametrize("seconds", [0.0, 0.6])
def test_a(seconds):
    time.sleep(seconds)

def test_b(): ...
"""


@pytest.fixture
def collected(pytester):
    """Names of the tests that pytest runs with some options."""
    pytester.makeconftest(Path(long_share.__file__).read_text())
    (pytester.path / "slow.txt").write_text(SLOW)
    pytester.makeini("[pytest]\nmarkers = long: long\n  slow: slow")
    pytester.makepyfile(test_x=TESTS)

    def names(*options):
        result = pytester.runpytest_inprocess("--collect-only", "-q", "-p", "no:cacheprovider", *options)
        return [line.partition("::")[2] for line in result.outlines if "::" in line]

    return names


def test_a_plain_run_takes_a_tenth_of_each_test(collected):
    names = collected()
    starts = ("test_seeds[", "test_few[", "test_costly[", ("test_alone", "test_turns[0]"))
    assert [sum(name.startswith(start) for name in names) for start in starts] == [5, 1, 2, 1]
    assert {"test_short", "test_few[a]"} <= set(names)
    assert names[:5] != [f"test_seeds[{i}]" for i in range(5)], "a choice, not the first ones"
    assert collected() == names, "the same choice every time"


def test_every_case_on_demand(collected):
    assert len(collected("--long")) == 45 + 3 + 50 + 30 + 2 + 1 + 20


@pytest.mark.parametrize("options", [("--slow",), ("-k", "slow"), ("-m", "slow"), ("test_x.py",)])
def test_slow_tests_are_all_run_where_they_are_asked_for(collected, options):
    assert sum(name.startswith("test_slow[") for name in collected()) == 2
    assert sum(name.startswith("test_slow[") for name in collected(*options)) == 20


def test_slow_tests_are_noted(pytester):
    """By the time of their slowest case, in workers too."""
    pytester.makeconftest(Path(long_share.__file__).read_text())
    pytester.makeini("[pytest]\nmarkers = long: long\n  slow: slow")
    pytester.makepyfile(test_x=CASES)
    pytester.runpytest_inprocess("--note-slow", "-n", "2", "-p", "no:cacheprovider")
    assert (pytester.path / "slow.txt").read_text() == "test_x.py::test_a\n"


def test_listed_tests_exist():
    """A name that is gone takes nothing from a plain run; it says that the list is old."""
    for name in long_share._SLOW.read_text().splitlines():
        file, _, test = name.partition("::")
        assert f"def {test}(" in (Path(__file__).parents[1] / file).read_text(), (
            f"{name}: pytest --note-slow writes the list"
        )
