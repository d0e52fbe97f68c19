"""Selection of compiled twins of the most expensive classes, if the package ``ffsm-mj-fast`` (extra ``fast``) is installed.

A twin has the name, the methods and the arithmetic of the class that it replaces; ``FFSM_COMPILED=0`` in the environment
disables all twins. Tests compare each twin with its original.
"""

from __future__ import annotations

import importlib
import os
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from types import ModuleType
from typing import TypeVar

from ffsm_mj.errors import TwinsError, described

INTERFACE = "7a8721c7964f"
"""Fingerprint of the public names of every class that has a twin; ``tests/test_compiled.py`` computes it.

Twins state the fingerprint for which they are written. A build from other sources of the same version states another one.
"""

Class = TypeVar("Class", bound=type)


def is_compiled() -> bool:
    """Whether twins are used: they are installed, and the environment does not set ``FFSM_COMPILED=0``."""
    return os.environ.get("FFSM_COMPILED", "1") != "0" and _twins() is not None


def fastest(plain: Class) -> Class:
    """The compiled twin of a class, or the class itself if twins are not used.

    Raises:
        TwinsError: The installed twins belong to another version of ffsm-mj or MuJoCo, or are built from other sources.
    """
    twins = _twins() if is_compiled() else None
    twin: Class = plain if twins is None else getattr(twins, plain.__name__)
    return twin


@cache
def _twins() -> ModuleType | None:
    if not find_spec("ffsm_mj_fast"):
        return None
    ours, theirs = version("ffsm-mj"), version("ffsm-mj-fast")
    if ours != theirs:
        raise TwinsError(f"ffsm-mj-fast {theirs} does not fit ffsm-mj {ours}")
    try:
        twins = importlib.import_module("ffsm_mj_fast")
    except (ImportError, AttributeError) as error:  # AttributeError: a name of ffsm-mj that is not there any more
        raise TwinsError(f"ffsm-mj-fast {theirs} cannot be used ({described(error)})") from error
    if getattr(twins, "INTERFACE", "") != INTERFACE:
        raise TwinsError(f"the installed ffsm-mj-fast {theirs} is built from other sources than this ffsm-mj")
    return twins
