"""Names and files that a user probably meant by one that does not exist."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher, get_close_matches
from pathlib import Path

_SHORT = 4
_SEPARATORS = re.compile(r"[._/ -]")


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """`` (did you mean 'NAME'?)`` with the most similar of the valid names; empty if none is similar."""
    close = similar_name(name, sorted(set(valid)))
    return f" (did you mean {close!r}?)" if close else ""


def most_similar_first(name: str, names: Iterable[str]) -> list[str]:
    """Names by their similarity to one that does not exist, without the prefix of a model; equal ones by alphabet."""
    asked = name.lower().rpartition("/")[2]
    return sorted(names, key=lambda one: (-SequenceMatcher(None, asked, one.lower().rpartition("/")[2]).ratio(), one))


def similar_name(name: str, names: Sequence[str]) -> str:
    """The name that was probably meant: equal but for case, similar as a whole, or with one part as it was written."""
    asked = name.lower()
    lower = {one.lower(): one for one in reversed(names)}
    close = get_close_matches(asked, lower, n=1) if asked not in lower else [asked]
    short_names = {full.rpartition("/")[2]: full for full in lower}  # without the prefix of a model
    close = close or [short_names[match] for match in get_close_matches(asked, short_names, n=1)]
    # Similarity is relative to the length: of a short name one wrong letter is too much for it.
    close = close or [one for one in lower if len(one) <= _SHORT and _one_letter_apart(asked, one)]
    close = close or [one for one in lower if len(asked) > 1 and asked in _SEPARATORS.split(one)]
    close = close or [one for one in lower if len(asked) > 2 and one.startswith(asked)]
    return lower[close[0]] if close else ""


def _one_letter_apart(a: str, b: str) -> bool:
    """Whether one letter added, removed, replaced, or exchanged with its neighbour, turns one word into the other."""
    if len(a) == len(b):
        wrong = [i for i in range(len(a)) if a[i] != b[i]]
        exchanged = len(wrong) == 2 and a[wrong[0]] + a[wrong[1]] == b[wrong[1]] + b[wrong[0]]
        return exchanged or (len(wrong) == 1 and len(a) > 1)
    short, long = sorted((a, b), key=len)
    return len(short) > 0 and any(long[:i] + long[i + 1 :] == short for i in range(len(long)))


def similar_file(path: Path) -> str:
    """`` (did you mean 'PATH'?)`` with the most similar name in the folder of a file that does not exist, or empty."""
    try:
        there = sorted(path.parent.iterdir())
    except OSError:
        return ""
    # Stems only: files of one kind would be similar by their suffix alone.
    stems = {file.stem: file for file in there if file != path and (file.suffix == path.suffix or not path.suffix)}
    similar = similar_name(path.stem, list(stems))
    if not similar:  # the same name with another suffix
        similar = next((file.stem for file in there if path.suffix and file.stem == path.stem), "")
        stems = {file.stem: file for file in there}
    return f" (did you mean {str(stems[similar])!r}?)" if similar else ""
