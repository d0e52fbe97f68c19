"""Bodies on fixed bodies of several pieces: models, scenarios, and how two runs of the same motion are compared."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import numpy as np

from tests.random_scenes.dice import numbers
from tests.scenes import scene

GRAVITY = '<option gravity="0 0 -9.81"/>'
NAMES = ("pair", "geoms", "robot_geom", "object_geom", "closed_pairs")
"""Fields of records that name pieces: nothing else may depend on them."""

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Lower and upper corner, m, axes of the body."""


def geoms(boxes: Iterable[Box], name: str = "b") -> str:
    """Boxes as geoms of one body, ``b0``, ``b1`` and so on."""
    texts = []
    for number, (lower, upper) in enumerate(np.asarray(tuple(boxes), dtype=float)):
        size, place = numbers((upper - lower) / 2.0), numbers((upper + lower) / 2.0)
        texts.append(f'<geom name="{name}{number}" type="box" size="{size}" pos="{place}" mass="0"/>')
    return "".join(texts)


def fixed(inner: str, assets: str = "", gravity: str = GRAVITY) -> str:
    """A model whose geoms belong to the world."""
    return f"<mujoco>{gravity}<asset>{assets}</asset><worldbody>{inner}</worldbody></mujoco>"


def free(
    inner: str,
    *,
    name: str = "body",
    mass: float = 2.0,
    inertia: Sequence[float] = (0.008, 0.008, 0.008),
    joint: str = '<freejoint name="free"/>',
    assets: str = "",
    gravity: str = GRAVITY,
) -> str:
    """A model of one body that floats, with these geoms."""
    return f"""<mujoco>{gravity}<asset>{assets}</asset><worldbody><body name="{name}">{joint}
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{numbers(inertia)}"/>{inner}</body></worldbody></mujoco>"""


def on(
    folder: Path,
    body: str,
    floor: str,
    *,
    joints: Sequence[float],
    rates: Sequence[float] = (0.0,) * 6,
    restitution: float = 0.0,
    mu: float = 0.0,
    pose: dict[str, Any] | None = None,
    **scenario: Any,
) -> Path:
    """A free body, the robot, on a fixed one under gravity, for 1 s by steps of 2 ms; the rule of the contact is ``hit``."""
    folder.mkdir(exist_ok=True)
    contacts = {"rules": [{"name": "hit", "between": ["robot", "floor"], "restitution": restitution, "mu": mu}]}
    return scene(
        folder,
        body,
        {"floor": floor},
        fixed={"floor": pose or {}},
        **{
            "time_step_s": 2e-3,
            "control_period_s": 2e-3,
            "conservative": False,
            "initial": {"joints": {"free": [*map(float, joints)]}, "rates": {"free": [*map(float, rates)]}},
            "contacts": contacts,
            **scenario,
        },
    )


def text_of(path: Path) -> str:
    """All files of a scene, to run it by hand."""
    return "\n".join(f"--- {file.name}\n{file.read_text()}" for file in sorted(path.parent.iterdir()) if file.is_file())


@dataclass(frozen=True)
class Event:
    """A record without the names of pieces.

    Attributes:
        kind: Its kind.
        texts: Its texts, by field.
        values: Its numbers, by field.
    """

    kind: str
    texts: tuple[tuple[str, str], ...]
    values: dict[str, np.ndarray]

    @property
    def order(self) -> tuple[Any, ...]:
        """Where it stands among the records of its instant: contacts of one instant have no order."""
        return self.kind, self.texts, *np.round(self.values["point_m"], 6), *np.round(self.values["normal"], 6)


def events_of(run: Any) -> list[Event]:
    """All events of a run, those of one instant in an order that names do not change."""
    ordered = []
    for _, group in groupby(run.log.events, key=lambda record: (type(record), getattr(record, "event", None))):
        ordered += sorted(filter(None, map(_event, group)), key=lambda event: event.order)
    return ordered


def _event(record: Any) -> Event | None:
    """An event of a contact; None for others, such as the beginnings of phases."""
    if not hasattr(record, "normal"):
        return None
    texts, values = [], {}
    for field in fields(record):
        value = getattr(record, field.name)
        if field.name in NAMES or field.name == "event":
            continue
        if isinstance(value, str):
            texts.append((field.name, value))
        elif isinstance(value, dict):
            values[field.name] = np.array([number for name in sorted(value) for number in np.atleast_1d(value[name])])
        else:
            values[field.name] = np.atleast_1d(np.asarray(value, dtype=float))
    return Event(type(record).__name__, tuple(texts), values)


@dataclass(frozen=True)
class Difference:
    """What two runs say differently.

    Attributes:
        what: The column, or the field of a kind of event: which of many events it is of does not matter.
        place: Number of the row or event.
        size: How large it is; infinite of what is no number.
        text: It in words.
    """

    what: str
    place: int
    size: float
    text: str

    def __str__(self) -> str:
        return self.text


def differences(run: Any, other: Any, tolerance: float, most: int | None = 10) -> Iterator[Difference]:
    """What two runs say differently beyond ``tolerance`` (1 + size), names of pieces aside; the first few of each sort."""
    if run.outcome != other.outcome:
        text = f"{other.outcome} ({other.message}), was {run.outcome} ({run.message})"
        yield Difference(other.outcome, 0, math.inf, text)
    ours, theirs = events_of(run), events_of(other)
    kinds, other_kinds = ([_said(event) for event in events] for events in (ours, theirs))
    apart = (i for i, (a, b) in enumerate(zip(kinds, other_kinds, strict=False)) if a != b)
    at = next(apart, min(len(ours), len(theirs)))
    yield from islice(_wrong_numbers(ours[:at], theirs[:at], tolerance), most)
    if kinds != other_kinds:
        said, was = (" ".join(map(str, k[at : at + 3])) or "none" for k in (other_kinds, kinds))
        text = f"{len(theirs)} events, were {len(ours)}; from event {at + 1} on: {said}; were: {was}"
        yield Difference("events", at, math.inf, text)
    yield from islice(_wrong_columns(run, other, tolerance), most)


def _said(event: Event) -> str:
    return f"{event.kind} at {event.values['time_s'][0]:.6f} s " + " ".join(text for _, text in event.texts)


def _wrong_numbers(ours: Sequence[Event], theirs: Sequence[Event], tolerance: float) -> Iterator[Difference]:
    for i, (event, other) in enumerate(zip(ours, theirs, strict=True)):
        for name, value in event.values.items():
            again, what = other.values[name], f"{event.kind} {event.texts} {name}"
            if value.shape != again.shape:
                yield Difference(what, i, math.inf, f"{_said(event)}: {name} has {again.size} numbers, had {value.size}")
            elif (size := _apart(value, again)) > tolerance:
                yield Difference(what, i, size, f"{_said(event)}: {name} off by {size:.1e}")


def _apart(value: np.ndarray, again: np.ndarray) -> float:
    """Largest difference over 1 + size; numbers that are missing in both are equal, in one infinitely apart."""
    apart = np.where(np.isnan(value) & np.isnan(again), 0.0, np.abs(value - again))
    scale = 1.0 + float(np.nanmax(np.abs(value), initial=0.0))
    return float(np.max(np.nan_to_num(apart, nan=np.inf), initial=0.0)) / scale


def _wrong_columns(run: Any, other: Any, tolerance: float) -> Iterator[Difference]:
    """Rows in which a column differs by more than before."""
    if len(run.time) != len(other.time):
        yield Difference("rows", 0, math.inf, f"{len(other.time)} rows, were {len(run.time)}")
        return
    for key in run.keys:
        if not key.startswith(("state.", "contact.", "energy.", "momentum.")) or key not in other.keys:
            continue
        values, again = (np.asarray(either[key], dtype=float) for either in (run, other))
        rows = [_apart(a, b) for a, b in zip(values[:, None], again[:, None], strict=True)]
        highest = np.maximum.accumulate([tolerance, *rows])
        for i in np.flatnonzero(highest[1:] > highest[:-1]).tolist():
            yield Difference(key, i, rows[i], f"{key} off by {rows[i]:.1e} at {run.time[i]:g} s")
