"""Judges the answer of a command by the threat model: a documented exit code, and lines that name place and fault."""

from __future__ import annotations

import re

from tests.hostile.cases import Case

_CODES = (0, 1, 2, 3, 4, 5, 130)
_NOISE = re.compile(r"Traceback|Warning\b|WARNING|Fatal Python error|Timeout \(|Exception ignored|^Error", re.MULTILINE)
_OUTCOMES = "diverged|event_limit|unsupported_contact|controller_failed|write_failed|violated"


def complaint(case: Case, command: tuple[str, ...], code: int, stderr: str) -> str:
    """What is wrong with an answer; empty where nothing is."""
    lines = stderr.splitlines()
    noise = _NOISE.search(stderr)
    if noise:
        return f"stderr holds {noise.group()!r}"
    if code not in _CODES:
        return f"exit code {code}"
    if code == 0:
        return f"exit code 0 with {len(lines)} lines on stderr" if lines else ""
    if not lines and command[0] != "analyze" and command[:2] != ("campaign", "rerun"):  # their verdicts are output
        return f"exit code {code} without a word"
    if code == 3 and not re.match(rf"({_OUTCOMES}): \S", lines[0]):
        return "a failed run that does not name its outcome"
    bad = [line for line in lines if not _located(case, command, line)] if code == 2 else []
    return f"no file or place in: {bad[0]}" if bad else ""


def control_character(*texts: str) -> str:
    """What of an output a terminal could take for more than text; empty where nothing is."""
    odd = [c for text in texts for c in text.replace("\n", "") if not c.isprintable()]
    return f"prints {odd[0]!r}" if odd else ""


def _located(case: Case, command: tuple[str, ...], line: str) -> bool:
    """Whether a line says where a fault is, and what it is."""
    if re.search(r"', line 0\b", line):
        return False
    # The target of a link, the folder that the command names, or a log.
    if re.match(r"(/\S+:\d+:\d+|\.): \S|log \S+\.mcap has \S", line):
        return True
    begins = r"-s |overrides: |--\w+[: ]|'': |ffsm[: ]|new: |new-law: |logs/\S+: |workers: |run \d+: |\S+: no such run\b"
    if re.match(begins, line):
        return ": " in line or "--" in line
    names = sorted(
        {
            *case.files,
            *case.folders,
            *(name for name, _ in case.links),
            *(word for word in command[1:] if not word.startswith("-")),
        },
        key=len,
        reverse=True,
    )
    shown = [name.encode("unicode_escape").decode() for name in names if name]
    place = re.match(
        rf"(log )?(?P<file>\S*?(?:{'|'.join(map(re.escape, [*filter(None, names), *shown]))}))(?::\d+)?(?::\d+)?: \S", line
    )
    return place is not None or bool(
        re.match(r"\S+\.(yaml|yml|xml|urdf|mcap|gif|mp4|html|csv|parquet|json|sqlite|md)(:\d+(:\d+)?)?: \S", line)
    )
