"""Whether a committed page says what a new run says: the same words, the same numbers to the digits they are given in."""

from __future__ import annotations

import re
from itertools import zip_longest

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")


def stale_lines(committed: str, fresh: str) -> list[str]:
    """Lines that differ, by more than one unit of a number's last committed digit, as messages with the line's number."""
    pairs = zip_longest(committed.splitlines(), fresh.splitlines(), fillvalue="")
    return [
        f"line {number}: committed {old!r}, now {new!r}"
        for number, (old, new) in enumerate(pairs, start=1)
        if not _same(old, new)
    ]


def _same(old: str, new: str) -> bool:
    if old == new:
        return True
    if _NUMBER.sub("#", old) != _NUMBER.sub("#", new):
        return False
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    return all(abs(float(a) - float(b)) <= 1.000001 * _unit(a) for a, b in pairs)


def _unit(text: str) -> float:
    """One unit of the last digit."""
    mantissa, _, exponent = text.lower().partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))
