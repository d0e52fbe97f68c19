"""Colours: on a terminal that shows them, for lines that fail, and never from a file."""

from __future__ import annotations

import io
import sys

import pytest

from ffsm_mj.cli.standard_streams import Output, complain
from ffsm_mj.report.terminal import table

RED, END = "\x1b[1;31m", "\x1b[0m"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def terminals(monkeypatch, **environment):
    """Terminals as stdout and stderr; not a fixture, because pytest sets its own streams between setup and test."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    for name, value in ({"TERM": "xterm"} | environment).items():
        monkeypatch.setenv(name, value)
    streams = Terminal(), Terminal()
    monkeypatch.setattr(sys, "stdout", streams[0])
    monkeypatch.setattr(sys, "stderr", streams[1])
    return streams


TABLE = "  energy  total  1.0  FAILED\n  energy  robot  0.0  passes"


def test_lines_that_fail_are_red(monkeypatch):
    out, err = terminals(monkeypatch)
    Output().say(TABLE)
    complain("FAILED: energy of total")
    assert out.getvalue() == f"{RED}  energy  total  1.0  FAILED{END}\n  energy  robot  0.0  passes\n"
    assert err.getvalue() == f"{RED}FAILED: energy of total{END}\n"


def test_every_line_of_a_folded_row_has_its_colour(monkeypatch):
    out, _ = terminals(monkeypatch)
    monkeypatch.setattr("ffsm_mj.report.terminal.terminal_width", lambda: 40)
    rows = [("no joint past its limit", "4.4e-16", "FAILED"), ("contact geometry", "1.0e-09", "passes")]
    Output().say(table(("check", "worst", ""), rows))
    lines = out.getvalue().splitlines()
    red = [line for line in lines if line.startswith(RED) and line.endswith(END)]
    assert [line for line in lines if "\x1b" in line] == red
    assert " ".join("".join(red).replace(RED, " ").replace(END, " ").split()) == "no joint past its 4.4e-16 FAILED limit"


def test_colours_of_a_file_are_escaped(monkeypatch):
    out, _ = terminals(monkeypatch)
    Output().say("a name \x1b[32m FAILED")
    assert out.getvalue() == f"{RED}a name \\x1b[32m FAILED{END}\n"


@pytest.mark.parametrize(("variable", "value"), [("NO_COLOR", "1"), ("TERM", "dumb"), ("TERM", "")])
def test_no_colours_where_they_are_not_wanted_or_not_shown(monkeypatch, variable, value):
    out, _ = terminals(monkeypatch, **{variable: value})
    Output().say(TABLE)
    assert out.getvalue() == TABLE + "\n"


def test_no_colours_in_a_file(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stdout", stream)
    Output().say(TABLE)
    assert stream.getvalue() == TABLE + "\n"
