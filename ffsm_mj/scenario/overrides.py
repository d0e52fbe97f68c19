"""Overrides as programs state them: texts as on the command line, or values by dotted key."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from ffsm_mj.errors import InputError
from ffsm_mj.scenario.loading import plain
from ffsm_mj.scenario.source import key_and_value

Overrides: TypeAlias = Sequence[str] | Mapping[str, Any]
"""Changes of a scenario or a campaign: ``key=value`` texts as on the command line, or values by dotted key, numpy's too."""


def as_texts(overrides: Overrides) -> list[str]:
    """Overrides as on the command line.

    Raises:
        InputError: A value cannot stand in a file, such as a model in memory, or the overrides are one text.
    """
    if isinstance(overrides, str):
        raise InputError(f"overrides: {overrides!r} is one text; write [{overrides!r}], or a mapping of keys to values")
    if isinstance(overrides, Mapping):
        return [f"{key}={_json(key, value)}" for key, value in overrides.items()]
    return list(overrides)


def by_key(overrides: Overrides) -> dict[str, Any]:
    """Overrides as values by dotted key, of one key the last.

    Raises:
        InputError: A text is not ``key=value``.
    """
    return dict(overrides) if isinstance(overrides, Mapping) else dict(map(key_and_value, as_texts(overrides)))


def _json(key: str, value: Any) -> str:
    try:
        return json.dumps(plain(value, (key,)))
    except (TypeError, ValueError) as error:
        raise InputError(f"{key}: {error}; an override has a value that a file can have") from error
