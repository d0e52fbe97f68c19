"""Text for a terminal: lines wrapped between words, tables that fit."""

from __future__ import annotations

import shlex
import sys

import pytest

from ffsm_mj.report import terminal as module
from ffsm_mj.report.terminal import FOLD, table, wrapped, wrapped_command

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
    return lambda width: monkeypatch.setattr(module, "terminal_width", lambda: width)


@pytest.mark.parametrize(("tty", "columns", "width"), [(True, 60, 60), (True, 39, None), (False, 60, None)])
def test_the_width_is_that_of_the_terminal(monkeypatch, tty, columns, width):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: tty)
    monkeypatch.setenv("COLUMNS", str(columns))
    assert module.terminal_width() == width


def test_a_table_in_a_file_is_not_divided(terminal):
    terminal(None)
    assert table(HEAD, ROWS) == WHOLE


def test_a_wide_terminal_gets_one_table(terminal):
    terminal(34)
    assert table(HEAD, ROWS) == WHOLE


@pytest.mark.parametrize("width", [46, 44, 40])
def test_a_narrow_terminal_folds_texts_and_keeps_numbers(width, terminal):
    """No line is longer than the terminal, nothing of a text is lost, and no number is divided."""
    terminal(width)
    lines = table(("pair", "time", "of"), [("robot/gripper-object/box/lid", "0.123456789", "total")]).splitlines()
    assert len(lines) > 2
    assert max(map(len, lines)) <= width
    assert lines[1].split()[1:] == ["0.123456789", "total"]
    assert "".join([lines[1].split()[0], *(line.strip() for line in lines[2:])]) == "robot/gripper-object/box/lid"


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


def test_nothing_of_a_row_is_cut_where_even_folded_texts_do_not_fit(terminal):
    """Of this row 43 columns are needed, 11 for the longest word of its text: the last one is the verdict."""
    terminal(40)
    rows = table(("check", "worst", "allowed", ""), [("no penetration", "4.4e-16", "1.0e-09", "truncation")]).splitlines()
    assert max(map(len, rows)) == 43
    assert rows[1].endswith("truncation")


def test_lines_are_wrapped_before_words_and_not_within_a_quantity_or_a_vector(terminal):
    terminal(40)
    line = "  capture grasp: robot/tip on satellite/grapple, impulse 0.01365 N s and 1e-05 N m s, loss 1.7 J"
    assert wrapped(line).split("\n") == [
        "  capture grasp: robot/tip on",
        "    satellite/grapple, impulse",
        "    0.01365 N s and 1e-05 N m s, loss",
        "    1.7 J",
    ]
    row = "    satellite/right_fixture    2.4978  -0.5504   1.000  0.006"
    assert wrapped(row).split("\n") == ["    satellite/right_fixture", "      2.4978  -0.5504   1.000  0.006"]
    terminal(None)
    assert wrapped(line) == line


def test_folded_texts_keep_numbers_and_units_whole(terminal):
    terminal(40)
    rows = [("angular impulse on the object, N m s", "0.2235", "agrees"), ("within 1.5 rad/s of it all", "1.0", "agrees")]
    text = table(("quantity", "source", "verdict"), rows).replace(FOLD, "\n")
    assert max(map(len, text.split("\n"))) <= 40
    assert "N m s" in text
    assert "1.5 rad/s" in text
    assert "\N{NO-BREAK SPACE}" not in text


@pytest.mark.parametrize("width", [40, 60, 80])
def test_a_command_is_the_same_command_however_it_is_wrapped(terminal, width):
    """What is copied from a narrow terminal is what a shell takes as one command, quoted words whole."""
    terminal(width)
    words = ["uv", "run", "ffsm", "run", "a file with a name/of many words.yaml", "-s", "a.b='c d'", *["--option", "x"] * 6]
    lines = wrapped_command("view: ", shlex.join(words)).split("\n")
    assert max(map(len, lines)) <= max(width, len("'a file with a name/of many words.yaml' \\") + 2)
    assert all(line.endswith(" \\") for line in lines[:-1])
    assert shlex.split("\n".join(lines).removeprefix("view: ").replace("\\\n", " ")) == words
