"""Faults of a scenario file that an override causes: the override is named, not only the line of the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from ffsm_mj.errors import InputError, one_line
from ffsm_mj.invocation import override

_MOST_TRIED = 8
"""With more overrides, all of them are named: the scenario is prepared once without each."""


@contextmanager
def overrides_named(overrides: Sequence[str], prepare: Callable[[Sequence[str]], object]) -> Iterator[None]:
    """Context that names, in front of each fault raised in it, the override without which there is no such fault.

    Args:
        overrides: Overrides with which the scenario is prepared in the context.
        prepare: Prepares the scenario again with some of the overrides.

    Raises:
        InputError: The faults. A fault that the file has of its own is unchanged.
    """
    try:
        yield
    except InputError as error:
        if all(map(_is_named, error.lines)) or not overrides:
            raise
        raise InputError(list(_named(error.lines, overrides, prepare))) from error


def _named(lines: Sequence[str], overrides: Sequence[str], prepare: Callable[[Sequence[str]], object]) -> Iterator[str]:
    alone = _faults(prepare, ())
    without = (
        [_faults(prepare, [*overrides[:i], *overrides[i + 1 :]]) for i in range(len(overrides))]
        if 1 < len(overrides) <= _MOST_TRIED
        else []
    )
    for line in lines:
        if _is_named(line) or not _is_gone(line, alone, lines):
            yield line
        else:
            causes = [text for text, faults in zip(overrides, without, strict=False) if _is_gone(line, faults, lines)]
            yield f"{' '.join(map(override, causes or overrides))}: {line}"


def _is_gone(line: str, faults: Sequence[str], lines: Sequence[str]) -> bool:
    """Whether there is no such fault any more; if there are other ones instead, it may only be hidden by them."""
    return line not in faults and set(faults) <= set(lines)


def _faults(prepare: Callable[[Sequence[str]], object], overrides: Sequence[str]) -> tuple[str, ...]:
    try:
        prepare(overrides)
    except InputError as error:
        return error.lines
    return ()


def _is_named(line: str) -> bool:
    return line.startswith(one_line(override("")))
