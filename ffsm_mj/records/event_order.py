"""Order of events at one instant that are numbered separately: only their states tell it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import TypeVar

Event = TypeVar("Event")


def merged(first: Sequence[Event], second: Sequence[Event], jump: Callable[[Event, Event], float]) -> list[Event]:
    """Merge two sequences so that the state after each event is nearest to that before the next.

    The two states need not be equal, as a drift projection may lie between them. Dynamic programming over the numbers of
    events taken from each sequence minimises the sum of all jumps; in a tie, those of the first sequence come first.

    Args:
        first: Events in their order.
        second: Others in theirs.
        jump: Distance between the state after one event and the state before another.
    """
    if not first or not second:
        return [*first, *second]
    both = first, second
    sums: dict[tuple[int, int, int], float] = {}
    before: dict[tuple[int, int, int], tuple[int, int, int]] = {}
    counts = len(first), len(second)
    for i, j, which in product(range(counts[0] + 1), range(counts[1] + 1), (0, 1)):
        if (i, j)[which]:
            event, rest = (first[i - 1], (i - 1, j)) if which == 0 else (second[j - 1], (i, j - 1))
            previous = [(*rest, last) for last in (1, 0) if rest[last]]
            found = [sums[each] + jump(both[each[2]][rest[each[2]] - 1], event) for each in previous]
            sums[i, j, which] = min(found, default=0.0)
            if found:
                before[i, j, which] = previous[found.index(min(found))]
    place: tuple[int, int, int] | None = min(((*counts, last) for last in (1, 0)), key=lambda end: sums[end])
    out = []
    while place is not None:
        out.append(both[place[2]][place[place[2]] - 1])
        place = before.get(place)
    return out[::-1]
