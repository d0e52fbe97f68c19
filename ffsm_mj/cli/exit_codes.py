"""Exit codes of the command line."""

from __future__ import annotations

from collections.abc import Mapping

OK, CHECK_FAILED, BAD_INPUT, RUN_FAILED, DAMAGED, TRUNCATED, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
OUTPUT_LOST = RUN_FAILED

_GENERAL = {OK: "done", BAD_INPUT: "bad input", OUTPUT_LOST: "output was lost (full disk)", INTERRUPTED: "interrupted"}
_TRUNCATION = "checks fail by the truncation of the step alone"
_NO_VERDICT = " (not by truncation alone, or without a verdict on it)"
_INCOMPLETE = "the log is damaged or incomplete"
_OF_COMMANDS = {
    "run": {
        CHECK_FAILED: f"a check fails{_NO_VERDICT}",
        RUN_FAILED: "the run failed (log kept), or output was lost (full disk)",
        TRUNCATED: _TRUNCATION,
        INTERRUPTED: "interrupted (log kept)",
    },
    "analyze": {
        CHECK_FAILED: f"a check fails{_NO_VERDICT}, or a log disagrees with its states",
        DAMAGED: _INCOMPLETE,
        TRUNCATED: _TRUNCATION,
    },
    "export": {DAMAGED: f"{_INCOMPLETE}; what it has is exported"},
    "view": {RUN_FAILED: "the viewer did not open, or there is no display"},
    "sensitivity": {RUN_FAILED: "the run failed, or output was lost (full disk)"},
    "validate": {CHECK_FAILED: "a number differs without a stated reason, or a page is stale (--check)"},
}
"""Meanings that are not general, by command."""


def exit_codes(command: str = "") -> str:
    """Sentence with the exit codes of a command; without one, those of every command."""
    more = "" if command else "; further codes: ffsm COMMAND --help"
    return exit_codes_with(_OF_COMMANDS.get(command, {})) + more


def exit_codes_with(meanings: Mapping[int, str]) -> str:
    """Sentence with the general exit codes, and with these in their place or in addition."""
    return "exit codes: " + "; ".join(f"{code} {meaning}" for code, meaning in sorted((_GENERAL | dict(meanings)).items()))
