"""A package with one control law, made from the one in ``my_law/``, which is valid as it stands."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from ffsm_mj.errors import InputError
from ffsm_mj.installation import add, has_pytest, run_tests
from ffsm_mj.invocation import command

_NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_TEMPLATE = "my_law"


def write_law(name: str, folder: Path, existing: tuple[str, ...]) -> list[str]:
    """Write the package of a new control law.

    Args:
        name: Its kind, module and package.
        folder: Where its folder, of the same name, is made.
        existing: Kinds that there are.

    Returns:
        Names of the files in the folder.

    Raises:
        InputError: A name that cannot be one of a module, is taken, or is that of something that stands there.
    """
    if not _NAME.fullmatch(name):
        raise InputError(f"new-law: {name!r} is not a module name: use lower-case letters, digits and single underscores")
    if name in existing:
        raise InputError(f"new-law: {name!r} is already the name of a control law ({', '.join(existing)})")
    home = folder / name
    if home.exists():
        raise InputError(f"new-law: {home} exists; nothing is written over it")
    home.mkdir(parents=True)
    template = files("ffsm_mj").joinpath("templates", _TEMPLATE)
    texts = {_named(place, name): _named(text, name) for place, text in _texts(template, "")}
    for place, text in texts.items():
        (home / place).parent.mkdir(exist_ok=True)
        (home / place).write_text(text, encoding="utf-8")
    return sorted(texts)


def next_commands(home: Path, name: str) -> list[str]:
    """Commands that install the package, run its scenario and test it, valid where the present command was typed.

    Args:
        home: Folder of the package.
        name: Name of the control law.
    """
    return [
        add(*([] if has_pytest() else ["pytest"]), "-e", str(home)),
        command("run", home / f"{name}.yaml"),
        run_tests(home),
    ]


def _texts(folder: Traversable, above: str) -> Iterator[tuple[str, str]]:
    """Files in a folder of the template and in folders of it: path from the template, and text."""
    for path in folder.iterdir():
        if path.is_file():
            yield above + path.name, path.read_text(encoding="utf-8")
        elif path.name != "__pycache__":
            yield from _texts(path, f"{above}{path.name}/")


def _named(text: str, name: str) -> str:
    """A text of the template with the law's name in each way of writing."""
    camel = "".join(part.capitalize() for part in name.split("_"))
    return text.replace("my_law", name).replace("my-law", name.replace("_", "-")).replace("MyLaw", camel)
