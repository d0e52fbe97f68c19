"""What a part of a run adds to a row: its signals together with how they are filled. A row is what all parts add."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import GROUPS, Layout, Signal


@dataclass(frozen=True)
class Columns:
    """Some signals of a part, and where their values come from: a live array, or a table for many samples at once.

    Attributes:
        signals: What the columns hold.
        live: Their values now, contiguous, (number of signals,); copied at each sample.
        table: In its place: their values at all samples since it was last called, (n, number of signals).
        note: Told the time in s at each sample, before anything is copied: to bring ``live`` up to date, or to keep what
            ``table`` will need.
        resume: Takes up what the columns say at a sample, (number of signals,), where a log is flown again from there on;
            zeros: from the beginning. None where they do not depend on what came before.
    """

    signals: tuple[Signal, ...]
    live: FloatArray | None = None
    table: Callable[[], FloatArray] | None = None
    note: Callable[[float], None] | None = None
    resume: Callable[[FloatArray], None] | None = None

    def __post_init__(self) -> None:
        """Refuse what could not be filled.

        Raises:
            ValueError: Neither or both of ``live`` and ``table``, or an array of another size.
        """
        if (self.live is None) == (self.table is None):
            raise ValueError("columns are filled from a live array or by a table")
        if self.live is not None and self.live.shape != (len(self.signals),):
            raise ValueError(f"a live array of shape {self.live.shape} for {len(self.signals)} signals")


class Row:
    """The columns of all parts in one row: a group's together, as in a log, otherwise in the order in which they came.

    Attributes:
        columns: Those of the parts.
        layout: All signals in the order of the row.
    """

    def __init__(self, columns: Iterable[Columns]) -> None:
        """Put them side by side, once.

        Raises:
            ValueError: Two signals of one name, or a group that there is not.
        """
        self.columns = tuple(columns)
        groups = list(GROUPS)
        self.layout = Layout(tuple(sorted(_signals(self.columns), key=lambda signal: groups.index(signal.group))))
        for one, other in same_names(self.columns):
            raise ValueError(f"two signals {one.key}: {one.description}; {other.description}")

    def stretches(self, part: Columns) -> Iterator[tuple[slice, slice]]:
        """Adjacent columns of a part, (which of its own, where in the row)."""
        places = self.layout.places(signal.key for signal in part.signals)
        edges = (np.flatnonzero(np.diff(places) != 1) + 1).tolist() if len(places) else []
        for start, stop in pairwise([0, *edges, len(places)]):
            first = int(places[start]) if stop > start else 0
            yield slice(start, stop), slice(first, first + stop - start)


def same_names(columns: Iterable[Columns]) -> list[tuple[Signal, Signal]]:
    """Pairs of signals that would be one column: the first of that name, and each other."""
    first: dict[str, Signal] = {}
    pairs = []
    for signal in _signals(columns):
        if signal.key in first:
            pairs.append((first[signal.key], signal))
        else:
            first[signal.key] = signal
    return pairs


def _signals(columns: Iterable[Columns]) -> Iterator[Signal]:
    for part in columns:
        yield from part.signals
