"""Columns of a log row: signals of each component of a run, together with the source of their values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import GROUPS, Layout, Signal


@dataclass(frozen=True)
class Columns:
    """Signals of one component and the source of their values: a live array, or what a table computes of its copies.

    Attributes:
        signals: Signals of the columns.
        live: Current values, contiguous, copied at each sample: of the columns, (number of signals,), or with ``table`` what
            that needs, (any number,).
        table: Computes the columns of many samples at once, (n, number of signals), from the copies of ``live`` at them,
            (n, size), later and maybe in another process: it must not depend on anything else that changes in a run.
        on_sample: Called with the time in s at each sample before anything is copied, to update ``live``.
        at_state: Values at a sample under the forces that act, (number of signals,). A log replay varies these forces by
            rounding and compares; columns that do not depend on forces, or have a state, may have any constant. None: no
            column depends on forces.
        at_event: The same for columns of values right after events since the last sample.
        resume: Restores the state of the columns from their values at a sample, (number of signals,), when a log is replayed
            from there; zeros: from the start. None if they have no state.
    """

    signals: tuple[Signal, ...]
    live: FloatArray
    table: Callable[[FloatArray], FloatArray] | None = None
    on_sample: Callable[[float], None] | None = None
    resume: Callable[[FloatArray], None] | None = None
    at_state: Callable[[], FloatArray] | None = None
    at_event: Callable[[], FloatArray] | None = None

    def __post_init__(self) -> None:
        """Validate the source of values.

        Raises:
            ValueError: The values of ``live`` are not those of the signals, and there is no table.
        """
        if self.table is None and self.live.shape != (len(self.signals),):
            raise ValueError(f"a live array of shape {self.live.shape} for {len(self.signals)} signals")


class Row:
    """A row with the columns of all components: ordered by group, as in a log, and within a group as given.

    Attributes:
        columns: Columns of the components.
        layout: All signals in the order of the row.
    """

    def __init__(self, columns: Iterable[Columns]) -> None:
        """Combine the columns.

        Raises:
            ValueError: Two signals of the same name, or an unknown group.
        """
        self.columns = tuple(columns)
        groups = list(GROUPS)
        self.layout = Layout(tuple(sorted(_signals(self.columns), key=lambda signal: groups.index(signal.group))))
        for one, other in same_names(self.columns):
            raise ValueError(f"two signals {one.key}: {one.description}; {other.description}")

    def stretches(self, part: Columns) -> Iterator[tuple[slice, slice]]:
        """Runs of adjacent columns of a component, as (slice of its own columns, slice of the row)."""
        places = self.layout.places(signal.key for signal in part.signals)
        edges = (np.flatnonzero(np.diff(places) != 1) + 1).tolist() if len(places) else []
        for start, stop in pairwise([0, *edges, len(places)]):
            first = int(places[start]) if stop > start else 0
            yield slice(start, stop), slice(first, first + stop - start)


def same_names(columns: Iterable[Columns]) -> list[tuple[Signal, Signal]]:
    """Pairs of signals with the same name: the first one, and each other."""
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
