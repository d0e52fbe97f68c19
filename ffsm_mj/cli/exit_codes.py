"""Exit codes of the command line."""

from __future__ import annotations

OK, CHECK_FAILED, BAD_INPUT, RUN_FAILED, DAMAGED, TRUNCATED, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
OUTPUT_LOST = RUN_FAILED

_GENERAL = {OK: "done", BAD_INPUT: "bad input", OUTPUT_LOST: "output was lost (full disk)", INTERRUPTED: "interrupted"}
_TRUNCATION = "checks fail by the truncation of the step alone"
_NO_VERDICT = " (not by truncation alone, or without a verdict on it)"
_INCOMPLETE = "the log is damaged or incomplete"
_EXECUTED = {
    OK: "every run has a result",
    BAD_INPUT: "bad input, changed settings, or already running elsewhere",
    RUN_FAILED: "stopped early (limits.max_failed, workers lost, full disk)",
    INTERRUPTED: "interrupted (results kept)",
}
_OF_COMMANDS: dict[str, dict[int, str]] = {
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
    **dict.fromkeys(("campaign run", "campaign resume", "campaign extend"), _EXECUTED),
    "campaign rerun": {RUN_FAILED: "a rerun differs from its result, or output was lost (full disk)"},
    "export": {DAMAGED: f"{_INCOMPLETE}; what it has is exported"},
    "view": {RUN_FAILED: "the viewer did not open, or there is no display"},
    "sensitivity": {RUN_FAILED: "the run failed, or output was lost (full disk)"},
    "validate": {CHECK_FAILED: "a number differs without a stated reason, or a page is stale (--check)"},
}
"""Meanings that are not general, by command."""


def exit_codes(command: str = "") -> str:
    """Sentence with the exit codes of a command; without one, those of every command."""
    codes = _GENERAL | _OF_COMMANDS.get(command, {})
    more = "" if command else "; further codes: ffsm COMMAND --help"
    return f"exit codes: {'; '.join(f'{code} {meaning}' for code, meaning in sorted(codes.items()))}{more}"
