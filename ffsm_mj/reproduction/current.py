"""Whether a committed page says what a new run says: the same words, the same numbers to the digits they are given in."""

from __future__ import annotations

import re
from difflib import SequenceMatcher

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")


def stale_lines(committed: str, fresh: str) -> list[str]:
    """Lines that differ, by more than one unit of a number's last committed digit, as messages with the line's number."""
    old, new = committed.splitlines(), fresh.splitlines()
    found = []
    matcher = SequenceMatcher(None, [_words(line) for line in old], [_words(line) for line in new], autojunk=False)
    for kind, i, i_end, j, j_end in matcher.get_opcodes():
        if kind == "equal":
            pairs = zip(range(i, i_end), old[i:i_end], new[j:j_end], strict=True)
            found += [_message(number, a, b) for number, a, b in pairs if not _same_numbers(a, b)]
        else:
            found.append(_message(i, " / ".join(old[i:i_end]), " / ".join(new[j:j_end])))
    return found


def _message(number: int, old: str, new: str) -> str:
    return f"line {number + 1}: committed {old!r}, now {new!r}"


def _words(line: str) -> str:
    return _NUMBER.sub("#", line)


def _same_numbers(old: str, new: str) -> bool:
    pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
    return all(abs(float(a) - float(b)) <= 1.000001 * _unit(a) for a, b in pairs)


def _unit(text: str) -> float:
    """One unit of the last digit."""
    mantissa, _, exponent = text.lower().partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))
