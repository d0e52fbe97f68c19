"""Names of files in a log. Anybody may have written them, so only plain relative paths are taken, whatever they are for."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable

MAX_COUNT = 10_000
MAX_LENGTH = 512


def fault_of_names(names: Iterable[str]) -> str:
    """What is wrong with the names of attachments, in a sentence; empty where nothing is."""
    known = list(names)
    if len(known) > MAX_COUNT:
        return f"{len(known)} attachments; at most {MAX_COUNT} are read"
    bad = next((name for name in known if not is_plain(name)), None)
    if bad is None:
        return ""
    shown = bad if len(bad) <= 80 else f"{bad[:80]}..."
    return f"the attachment {shown!r} has no plain relative path (forward slashes, no '..', at most {MAX_LENGTH} characters)"


def is_plain(name: str) -> bool:
    """Whether a name is a relative path that leads nowhere else on any system."""
    return (
        0 < len(name) <= MAX_LENGTH
        and name.isprintable()
        and not any(character in name for character in ":\\")
        and not name.startswith("/")
        and posixpath.normpath(name) == name
        and name.split("/", maxsplit=1)[0] not in (".", "..")
    )
