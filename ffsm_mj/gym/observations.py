"""Observations: values of a simulation at the present, by the names of columns of the log and of paths, as one vector."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import Faults, unknown_name
from ffsm_mj.gym.rewards import EnvError
from ffsm_mj.records.columns import Columns
from ffsm_mj.records.signals import TIME, TIP_RATE
from ffsm_mj.scenario.env_config import EnvConfig, ObservationConfig

Read = Callable[[Observation], FloatArray]
"""Reads a value at an observation, (n,)."""

_ELEMENTS = ("actuator", "body", "geom", "joint", "sensor", "site")
_PATHS = ("data.FIELD", "data.KIND.NAME.FIELD", "measured.SENSOR", "force_N.NAME", "closed_pairs", "time_s")


class Values:
    """Readers of values of one run by name.

    A column of the log is written with or without its group: ``state.q_robot_joint_1_rad``, ``q_robot_joint_1_rad``. Paths:
    ``data.qpos`` and other arrays of MuJoCo's data, ``data.site.tip.xpos`` and other fields of a named element,
    ``measured.SENSOR``, the newest sample that has arrived; ``force_N.RULE`` or ``force_N.PAIR``, the sum of the magnitudes
    of its forces of persistent contact; ``closed_pairs``, the number of pairs in persistent contact; ``time_s``.
    """

    def __init__(self, assembly: Assembly) -> None:
        """Bind to the components of a run."""
        self._assembly = assembly
        self._columns = {
            signal.key: (part, place) for part in assembly.row.columns for place, signal in enumerate(part.signals)
        }

    def reader(self, name: str, before: float | None = None) -> Read:
        """Reader of a value; of a sensor, ``before`` is each of its numbers until a sample has arrived.

        Raises:
            LookupError: There is no such value, or it is not known between rows of the log; the message lists what is. Or
                ``before`` is given of another value than that of a sensor.
        """
        head, _, rest = name.partition(".")
        if before is not None and head != "measured":
            raise LookupError(f"'before' is of samples that arrive, measured.SENSOR; {name} is known at any time")
        if name == "time_s":
            return lambda seen: np.array([seen.time_s])
        if name == "closed_pairs":
            return lambda seen: np.array([float(len(seen.contacts))])
        if head == "data" and rest:
            return self._of_data(name, rest)
        if head == "measured" and rest:
            return self._of_sensor(rest, before)
        if head == "force_N" and rest:
            return self._of_force(rest)
        return self._of_column(name)

    def scalar(self, name: str) -> Callable[[Observation], float]:
        """Reader of a value that is one number.

        Raises:
            LookupError: See :meth:`reader`; or the value has several numbers.
        """
        read = self.reader(name)
        size = len(read(self.now()))
        if size != 1:
            raise LookupError(f"{name} is {size} numbers: name one of them ({name}.0)")
        return lambda seen: float(read(seen)[0])

    def now(self) -> Observation:
        """An observation of the present without events and contacts, for the shapes of values."""
        data, sampler = self._assembly.data, self._assembly.plant.sampler
        measured = sampler.measured(0.0) if sampler is not None else {}
        return Observation(0.0, data, free=data, measured=measured)

    def _of_column(self, name: str) -> Read:
        keys = [key for key in self._columns if name in (key, key.partition(".")[2])]
        if len(keys) != 1:
            if keys:
                raise LookupError(f"column {name!r} is ambiguous; write one of {', '.join(keys)}")
            known = self.known_columns()
            raise LookupError(f"{unknown_name('column', name, known)}; or a path: {', '.join(_PATHS)}")
        key = keys[0]
        part, place = self._columns[key]
        if key == TIME:
            return lambda seen: np.array([seen.time_s])
        if key in TIP_RATE:
            return self._tip_rate(TIP_RATE.index(key))
        if not _is_present(part):
            raise LookupError(
                f"{key} is computed for rows of the log only; known at any time: {', '.join(self.known_columns())}"
            )
        return lambda _: part.live[place : place + 1].copy()

    def known_columns(self) -> list[str]:
        """Columns that are known at any time."""
        present = (key for key, (part, _) in self._columns.items() if _is_present(part))
        return [*dict.fromkeys([TIME, *present, *(key for key in TIP_RATE if key in self._columns)])]

    def _tip_rate(self, axis: int) -> Read:
        model, data = self._assembly.system.mj, self._assembly.data
        task, twist = self._assembly.task, np.zeros(6)
        assert task is not None
        kind, site = mujoco.mjtObj.mjOBJ_SITE, task.tip_site

        def read(_: Observation) -> FloatArray:
            mujoco.mj_objectVelocity(model, data, kind, site, twist, 0)
            return twist[3 + axis : 4 + axis].copy()

        return read

    def _of_data(self, name: str, path: str) -> Read:
        """Array of MuJoCo's data, or field of a named element, whole or one of its numbers."""
        system, data = self._assembly.system, self._assembly.data
        kind, _, rest = path.partition(".")
        holder: Any = data
        if kind in _ELEMENTS:
            element, _, field = _split_element(rest)
            holder = getattr(data, kind)(system.resolve(kind, element))
            path = field
        field, _, number = path.partition(".")
        array = getattr(holder, field, None) if field and not field.startswith("_") else None
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "fi" or not array.size:
            known = sorted(attribute for attribute in dir(holder) if _is_numbers(holder, attribute))
            raise LookupError(f"{name}: {unknown_name('field', field, known)}")
        flat = array.reshape(-1)
        if not number:
            return lambda _: np.array(flat, dtype=np.float64)
        place = _place(name, number, len(flat))
        return lambda _: np.array(flat[place : place + 1], dtype=np.float64)

    def _of_sensor(self, rest: str, initial: float | None) -> Read:
        sampler = self._assembly.plant.sampler
        by_name = sampler.by_name if sampler is not None else {}
        before, _, last = rest.rpartition(".")
        name, number = (before, last) if before and last.isdecimal() else (rest, "")
        full = self._assembly.system.resolve("sensor", name) if by_name else ""
        if full not in by_name:
            raise LookupError(unknown_name("sensor", name, by_name))
        part = slice(None)
        if number:
            place = _place(rest, number, len(self.now().measured[full].value))
            part = slice(place, place + 1)

        def read(seen: Observation) -> FloatArray:
            measurement = seen.measured[full]
            value = np.array(measurement.value[part], dtype=np.float64)
            # No time: nothing has arrived. A sample that has, and is not finite, remains an error.
            if initial is not None and np.isnan(measurement.time_s):
                value[:] = initial
            return value

        return read

    def _of_force(self, name: str) -> Read:
        pairs = self.pairs_of([name])

        def read(seen: Observation) -> FloatArray:
            return np.array(
                [sum(float(np.linalg.norm(contact.force_N)) for contact in seen.contacts if contact.pair in pairs)]
            )

        return read

    def pairs_of(self, names: Iterable[str]) -> frozenset[str]:
        """Names of the pairs that some contact rules and pairs stand for.

        Raises:
            LookupError: No such rule or pair.
        """
        pairs: set[str] = set()
        for name in names:
            matching = {pair.name for pair in self._assembly.pairs if name in (pair.name, pair.rule)}
            if not matching:
                known = {known for pair in self._assembly.pairs for known in (pair.rule, pair.name)}
                raise LookupError(unknown_name("contact rule or pair", name, known))
            pairs |= matching
        return frozenset(pairs)


def _is_present(part: Columns) -> bool:
    """Whether the values of columns are those of the present, not only of the last row."""
    return part.table is None and part.on_sample is None


def _split_element(rest: str) -> tuple[str, str, str]:
    """Name of an element, which may contain dots, and the field with its number."""
    parts = rest.split(".")
    fields = 2 if parts[-1].isdecimal() and len(parts) > 2 else 1
    return ".".join(parts[:-fields]), ".", ".".join(parts[-fields:])


def _is_numbers(holder: Any, name: str) -> bool:
    if name.startswith("_"):
        return False
    try:
        value = getattr(holder, name)
    except Exception:  # noqa: BLE001 (MuJoCo's structs raise what they like for what an element does not have)
        return False
    return isinstance(value, np.ndarray) and value.dtype.kind in "fi" and value.size > 0


def _place(name: str, number: str, count: int) -> int:
    if not number.isdecimal() or int(number) >= count:
        raise LookupError(f"{name} is {count} numbers: their positions are 0 to {count - 1}")
    return int(number)


class Observations:
    """The observation vector of an environment.

    Attributes:
        low: Least values, (n,).
        high: Greatest values, (n,).
        names: Name of the value of each entry, (n,).
    """

    def __init__(self, config: EnvConfig, values: Values) -> None:
        """Bind the parts of the observation vector to a run.

        Raises:
            ScenarioFaults: One fault per unknown name.
        """
        self._readers, self.names = list[Read](), list[str]()
        bounds: list[tuple[float, float]] = []
        with Faults() as faults:
            for i, part in enumerate(config.observations):
                one = part if isinstance(part, ObservationConfig) else ObservationConfig(of=part)
                with faults.below("env", "observations", i, *(("of",) if one is part else ())):
                    read = values.reader(one.of, one.before)
                    size = len(read(values.now()))
                    self._readers.append(read)
                    self.names += [one.of] if size == 1 else [f"{one.of}.{k}" for k in range(size)]
                    bounds += [(one.low, one.high)] * size
        self.low, self.high = np.array(bounds).T

    def read(self, observation: Observation) -> FloatArray:
        """The observation vector, (n,), a new array.

        Raises:
            EnvError: A value is not finite.
        """
        vector = np.concatenate([read(observation) for read in self._readers])
        if not np.isfinite(vector).all():
            bad = [name for name, value in zip(self.names, vector, strict=True) if not np.isfinite(value)]
            hint = ""
            if any(name.startswith("measured.") for name in bad):
                hint = "; until a sample arrives, '{of: measured.SENSOR, before: NUMBER}' gives a value"
            raise EnvError(f"observation at t = {observation.time_s:.6g} s: not finite: {', '.join(bad)}{hint}")
        return vector
