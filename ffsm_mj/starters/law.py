"""A package with one control law, made from the one in ``my_law/``, which is valid as it stands."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from ffsm_mj.errors import InputError

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_TEMPLATE = "my_law"


def write_law(name: str, folder: Path, taken: tuple[str, ...]) -> list[str]:
    """Write the package of a new control law.

    Args:
        name: Its kind, module and package.
        folder: Where its folder, of the same name, is made.
        taken: Kinds that there are.

    Returns:
        Names of the files in the folder.

    Raises:
        InputError: A name that cannot be one of a module, is taken, or is that of something that stands there.
    """
    if not _NAME.fullmatch(name):
        raise InputError(f"new-law: {name!r} is no name of a module: lower-case letters, digits and single underscores")
    if name in taken:
        raise InputError(f"new-law: {name!r} is a kind that there is already ({', '.join(taken)})")
    home = folder / name
    if home.exists():
        raise InputError(f"new-law: {home} exists; nothing is written over it")
    home.mkdir(parents=True)
    written = []
    for source in sorted(files("ffsm_mj").joinpath("starters", _TEMPLATE).iterdir(), key=lambda each: each.name):
        if source.is_file():
            (home / _named(source.name, name)).write_text(_named(source.read_text(encoding="utf-8"), name), encoding="utf-8")
            written.append(_named(source.name, name))
    return written


def _named(text: str, name: str) -> str:
    """A text of the template with the law's name in each way of writing."""
    camel = "".join(part.capitalize() for part in name.split("_"))
    return text.replace("my_law", name).replace("my-law", name.replace("_", "-")).replace("MyLaw", camel)
