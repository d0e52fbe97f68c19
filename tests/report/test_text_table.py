"""Text tables: in one part if the terminal is wide enough, else divided."""

from __future__ import annotations

import sys

import pytest

from ffsm_mj.report import text_table
from ffsm_mj.report.text_table import table

HEAD, ROWS = (
    ("law", "of", "worst", "unit", "at s"),
    [("energy", "total", "1e-12", "J", "3.5"), ("mass", "robot", "2", "kg", "0")],
)
WHOLE = """\
  law     of     worst  unit  at s
  energy  total  1e-12  J      3.5
  mass    robot      2  kg       0"""


@pytest.fixture
def terminal(monkeypatch):
    return lambda width: monkeypatch.setattr(text_table, "terminal_width", lambda: width)


@pytest.mark.parametrize(("tty", "columns", "width"), [(True, 60, 60), (True, 39, None), (False, 60, None)])
def test_the_width_is_that_of_the_terminal(monkeypatch, tty, columns, width):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: tty)
    monkeypatch.setenv("COLUMNS", str(columns))
    assert text_table.terminal_width() == width


def test_a_table_in_a_file_is_not_divided(terminal):
    terminal(None)
    assert table(HEAD, ROWS) == WHOLE


def test_a_wide_terminal_gets_one_table(terminal):
    terminal(34)
    assert table(HEAD, ROWS, keys=2) == WHOLE


@pytest.mark.parametrize("width", [33, 27, 26, 22, 5])
def test_a_narrow_terminal_gets_all_columns_in_parts(width, terminal):
    """No line is longer than the terminal unless a part has one column besides its keys, and no cell is lost."""
    terminal(width)
    parts = [[line.split() for line in part.split("\n")] for part in table(HEAD, ROWS, keys=2).split("\n\n")]
    assert len(parts) > 1
    for part in parts:
        assert [line[:2] for line in part] == [["law", "of"], ["energy", "total"], ["mass", "robot"]]
    if width >= 22:
        assert max(map(len, table(HEAD, ROWS, keys=2).split("\n"))) <= width
    assert [cell for part in parts for cell in part[1][2:]] == ["1e-12", "J", "3.5"]


def test_units_stand_below_the_names():
    assert table(("hit", "time\ns"), [("1", "0.5")]) == "  hit  time\n          s\n    1   0.5"


def test_columns_that_can_be_spared_are_left_out_first(terminal):
    terminal(28)
    assert table(HEAD, ROWS, spare=("unit", "at s")) == (
        "  law     of     worst  at s\n  energy  total  1e-12   3.5\n  mass    robot      2     0\n"
        "  left out on a narrow terminal: unit"
    )
    terminal(None)
    assert table(HEAD, ROWS, spare=("unit", "at s")) == WHOLE


def test_long_texts_are_shortened_in_their_middle(terminal):
    """To no less than 14 characters, and numbers never."""
    terminal(30)
    _, row = table(("pair", "time"), [("robot/gripper-object/box/lid", "0.123456789")]).splitlines()
    assert row == "  robot/...ox/lid  0.123456789"
