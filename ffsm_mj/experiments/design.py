"""Design of a campaign: sampled values of all runs, computed once and written before the first run."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, get_args
from zlib import crc32

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.errors import Fault, InputError, ScenarioFaults
from ffsm_mj.experiments.distributions import Dispersion, Operation, SampledScalar, sampled_scalars
from ffsm_mj.experiments.file import CampaignFile

KINDS = ("grid", "random", "lhs", "sobol", "saltelli")
EXTENDABLE = ("random", "sobol")
"""Kinds of samples whose first rows do not depend on the number of samples."""


def samples(kind: str, n: int, seed: int, names: Sequence[str], levels: Sequence[int] = ()) -> FloatArray:
    """Points in the unit cube.

    Args:
        kind: ``grid``, ``random``, ``lhs``, ``sobol`` or ``saltelli``.
        n: Number of samples; ``saltelli`` gives n (d + 2) rows, ``grid`` ignores it.
        seed: Seed of the random numbers.
        names: Names of the d coordinates; for ``random`` each has its own stream, so that a new one changes no other.
        levels: Number of levels of each coordinate, for ``grid``.

    Returns:
        Numbers from 0 to 1, (rows, d). For ``saltelli``: A, B, then A with each column of B in turn, n rows each.
    """
    d = len(names)
    if kind == "grid":
        centres = [(np.arange(count) + 0.5) / count for count in levels]
        return np.array(list(product(*centres)))
    if kind == "random":
        return np.array([[_uniform(seed, name, i) for name in names] for i in range(n)])
    from scipy.stats import qmc  # slow to import

    if kind == "lhs":
        return np.asarray(qmc.LatinHypercube(d, rng=np.random.default_rng(seed)).random(n))
    if kind == "sobol":
        return _sobol(d, n, seed)
    return _saltelli(_sobol(2 * d, n, seed))


def _uniform(seed: int, name: str, i: int) -> float:
    """Number i of the stream of a name, in (0, 1): one word of a seed sequence, equal in all versions of NumPy."""
    word = np.random.SeedSequence(seed, spawn_key=(crc32(name.encode()), i)).generate_state(1, np.uint64)[0]
    return ((int(word) >> 12) + 0.5) * 2.0**-52


def _sobol(d: int, n: int, seed: int) -> FloatArray:
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(d, scramble=True, rng=np.random.default_rng(seed)).random(n))


def _saltelli(pairs: FloatArray) -> FloatArray:
    """Rows A, B, and A with one column of B, from points (n, 2 d)."""
    a, b = np.hsplit(pairs, 2)
    blocks = [a, b]
    for column in range(a.shape[1]):
        mixed = a.copy()
        mixed[:, column] = b[:, column]
        blocks.append(mixed)
    return np.vstack(blocks)


Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class ValueOperation:
    """Operation of one entry of ``dispersions`` on a value.

    Attributes:
        operation: Kind of the operation.
        columns: Columns of its scalars in a row: one, or magnitude, height and azimuth for a random axis.
        at: Position of the number in nested lists; empty if the value is a number.
        span: First and end position of a vector or quaternion.
        axis: Axis or direction of any length; None if it is sampled.
    """

    operation: Operation
    columns: tuple[int, ...]
    at: tuple[int, ...] = ()
    span: tuple[int, int] | None = None
    axis: Vector3 | None = None

    def applied(self, value: Any, row: Sequence[Any]) -> Any:
        """Apply the operation to a value; returns the new value.

        Args:
            value: Plain value of the key; not modified.
            row: Sampled scalars of the run.
        """
        sampled = row[self.columns[0]]
        if self.span is None:
            old = value
            for position in self.at:
                old = old[position]
            return _replaced(value, self.at, _number(self.operation, old, sampled))
        first, end = self.span
        direction = self._direction(row)
        part = list(value[first:end])
        if self.operation == "rotation":
            new = rotated(part, direction, sampled)
        else:
            start = part if self.operation == "vector_offset" else [0.0] * 3
            new = [s + sampled * d for s, d in zip(start, direction, strict=True)]
        return [*value[:first], *new, *value[end:]]

    def _direction(self, row: Sequence[Any]) -> Vector3:
        """Unit vector of the axis or direction."""
        if self.axis is not None:
            length = math.hypot(*self.axis)
            return (self.axis[0] / length, self.axis[1] / length, self.axis[2] / length)
        height, azimuth = row[self.columns[1]], row[self.columns[2]]
        ring = math.sqrt(max(0.0, 1.0 - height * height))
        return (ring * math.cos(azimuth), ring * math.sin(azimuth), height)


def rotated(quaternion: Sequence[float], axis: Vector3, angle: float) -> list[float]:
    """Rotate an attitude about an axis of its parent frame.

    Args:
        quaternion: Attitude (w, x, y, z), of any length except zero.
        axis: Unit vector.
        angle: Angle, rad.

    Returns:
        Unit quaternion.
    """
    s = math.sin(0.5 * angle)
    w, v = math.cos(0.5 * angle), np.array([s * a for a in axis])
    w0, v0 = quaternion[0], np.array(quaternion[1:])
    product = np.array([w * w0 - v @ v0, *(w * v0 + w0 * v + np.cross(v, v0))])
    return (product / np.linalg.norm(product)).tolist()  # type: ignore[no-any-return]


def _number(operation: Operation, old: Any, sampled: Any) -> Any:
    if operation == "scale":
        return old * sampled
    return old + sampled if operation == "offset" else sampled


def _replaced(value: Any, at: tuple[int, ...], new: Any) -> Any:
    """Copy of a value with one number replaced."""
    if not at:
        return new
    return [_replaced(item, at[1:], new) if i == at[0] else item for i, item in enumerate(value)]


_FORMAT = 1
_LARGEST = 2**63
"""Bound of integers in the table."""


@dataclass(frozen=True)
class Binding:
    """A key of the scenario that every run sets.

    Attributes:
        key: Dotted key, with positions for items of lists.
        base: Plain value without dispersions, lists as tuples; None if there is none.
        effects: Operations of the samples on the value, in order.
    """

    key: str
    base: Any
    effects: tuple[ValueOperation, ...]


@dataclass(frozen=True)
class Design:
    """Sampled values of every run, and their effect on the scenario.

    Attributes:
        kind: Kind of samples.
        seed: Seed of the random numbers.
        n: Number of samples: number of rows, for ``saltelli`` rows / (d + 2).
        parameters: Names of the sampled parameters, columns of the table.
        rows: Sampled values, one tuple per run.
        bindings: Keys of the scenario that the runs set.
    """

    kind: str
    seed: int
    n: int
    parameters: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    bindings: tuple[Binding, ...]

    def overrides(self, run: int) -> dict[str, Any]:
        """Values (numbers, texts, lists of numbers) by dotted key of the scenario for a run, counted from 0."""
        found = {}
        for binding in self.bindings:
            value = binding.base
            for effect in binding.effects:
                value = effect.applied(value, self.rows[run])
            found[binding.key] = value
        return found

    def to_json(self) -> str:
        """JSON text for :meth:`from_json`; numbers are preserved bit for bit."""
        head = {"format": _FORMAT, "kind": self.kind, "seed": self.seed, "n": self.n, "parameters": self.parameters}
        lines = [f'"{key}": {json.dumps(value)}' for key, value in head.items()]
        for key, items in (("bindings", [asdict(binding) for binding in self.bindings]), ("rows", self.rows)):
            lines.append(f'"{key}": [\n' + ",\n".join(map(json.dumps, items)) + "\n]")
        return "{\n" + ",\n".join(lines) + "\n}\n"

    @classmethod
    def from_json(cls, text: str) -> Design:
        """Read a design from JSON text.

        Raises:
            InputError: The text is not a design, or has another format version.
        """
        try:
            data = json.loads(text)
            if data["format"] != _FORMAT:
                raise InputError(f"a design of format {data['format']}; this version reads {_FORMAT}")
            bindings = tuple(
                Binding(b["key"], _tuples(b["base"]), tuple(ValueOperation(**_tuples(effect)) for effect in b["effects"]))
                for b in data["bindings"]
            )
            rows = tuple(map(tuple, _tuples(data["rows"])))
            design = cls(data["kind"], data["seed"], data["n"], tuple(data["parameters"]), rows, bindings)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(f"not a design of a campaign ({type(error).__name__}: {error})") from error
        if fault := _fault(design):
            raise InputError(f"not a design of a campaign ({fault})")
        return design


def _fault(design: Design) -> str:
    """What is wrong with a design of unknown origin; empty if it is valid."""
    width = len(design.parameters)
    lists = {
        effect.columns[0]
        for binding in design.bindings
        for effect in binding.effects
        if _can_be_applied(effect, width) and _takes_list(binding.base, effect)
    }
    faults = {
        f"kind {design.kind!r}": design.kind not in KINDS,
        f"seed {design.seed!r}": not isinstance(design.seed, int),
        f"n {design.n!r}": not isinstance(design.n, int) or design.n < 1,
        "a parameter name is not a text": not all(isinstance(name, str) for name in design.parameters),
        "the number of values in a row differs from the number of parameters": any(len(row) != width for row in design.rows),
        "a value is not a number or text": not all(
            _is_sampled(value, i in lists) for row in design.rows for i, value in enumerate(row)
        ),
        "a key is not a text": not all(isinstance(binding.key, str) for binding in design.bindings),
        "an effect cannot be applied": not all(
            _can_be_applied(effect, width) for binding in design.bindings for effect in binding.effects
        ),
    }
    return next((fault for fault, found in faults.items() if found), "")


def _is_scalar(value: Any) -> bool:
    return isinstance(value, str | float) or (isinstance(value, int) and abs(value) < _LARGEST)


def _takes_list(base: Any, effect: ValueOperation) -> bool:
    """Whether a sampled list replaces the whole value."""
    return effect.operation == "value" and isinstance(base, tuple) and not effect.at and effect.span is None


def _is_sampled(value: Any, or_list: bool) -> bool:
    return _is_scalar(value) or (or_list and isinstance(value, tuple) and all(map(_is_scalar, value)))


def _can_be_applied(effect: ValueOperation, width: int) -> bool:
    axis, span = effect.axis, effect.span
    return (
        effect.operation in get_args(Operation)
        and _are_integers(effect.columns)
        and len(effect.columns) in (1, 3)
        and all(0 <= column < width for column in effect.columns)
        and _are_integers(effect.at)
        and (span is None or (_are_integers(span) and len(span) == 2))
        and (axis is None or (isinstance(axis, tuple) and len(axis) == 3 and all(map(_is_scalar, axis)) and any(axis)))
        and (span is None or axis is not None or len(effect.columns) == 3)
    )


def _are_integers(values: Any) -> bool:
    return isinstance(values, tuple) and all(isinstance(value, int) for value in values)


def _tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


_MOST_ROWS = 10_000_000


def sample_design(
    kind: str, n: int, seed: int, sampled_scalars: Sequence[SampledScalar], bindings: Sequence[Binding]
) -> Design:
    """Sample the design of a campaign; equal arguments give equal designs.

    For kinds of samples that can be extended, the first rows do not depend on n.

    Raises:
        ScenarioFaults: A distribution exceeds the range of floating-point numbers.
    """
    names = tuple(scalar.name for scalar in sampled_scalars)
    levels = [len(scalar.distribution.levels or ()) for scalar in sampled_scalars]
    points = samples(kind, n, seed, names, levels)
    values = [scalar.distribution.quantiles(points[:, k], scalar.mean) for k, scalar in enumerate(sampled_scalars)]
    for scalar, column in zip(sampled_scalars, values, strict=True):
        if not all(abs(value) <= sys.float_info.max for value in column if isinstance(value, int | float)):
            raise ScenarioFaults([Fault("exceeds the range of floating-point numbers", ("dispersions", scalar.entry))])
    return Design(kind, seed, n or len(points), names, tuple(zip(*values, strict=True)), tuple(bindings))


def refuse_levels(config: CampaignFile) -> None:
    """Refuse levels without a grid, a grid without levels, and designs with too many runs.

    Raises:
        ScenarioFaults: One fault per dispersion.
    """
    faults, grid = [], config.samples.kind == "grid"
    rows = 1 if grid else (config.samples.n or 1)
    columns = 0
    for name, dispersion in config.dispersions.items():
        for scalar in sampled_scalars(name, dispersion):
            columns += 1
            levels = scalar.distribution.levels
            if grid and levels is None:
                faults.append(Fault("has no levels for a grid; write values, choice or grid", ("dispersions", name)))
                break
            if not grid and scalar.distribution.grid is not None:
                message = f"has levels of a grid, but the samples are of kind {config.samples.kind}; write values or uniform"
                faults.append(Fault(message, ("dispersions", name)))
            rows *= len(levels or ()) if grid else 1
    if config.samples.kind == "saltelli":
        rows *= columns + 2
    if not faults and rows > _MOST_ROWS:
        faults.append(Fault(f"gives {rows} runs; at most {_MOST_ROWS}", ("samples",)))
    if faults:
        raise ScenarioFaults(faults)


def columns(dispersions: Mapping[str, Dispersion]) -> tuple[SampledScalar, ...]:
    """Scalars sampled for each run, in the order of the file.

    Raises:
        ScenarioFaults: Two scalars have the same name, or the same stream of random numbers.
    """
    found: dict[int, SampledScalar] = {}
    for name, dispersion in dispersions.items():
        for scalar in sampled_scalars(name, dispersion):
            other = found.setdefault(crc32(scalar.name.encode()), scalar)
            if other is not scalar:
                same = "have one column" if other.name == scalar.name else "would have equal random numbers"
                raise ScenarioFaults(
                    [
                        Fault(
                            f"{scalar.name} and {other.name} {same}; rename one entry, with its keys under 'keys'",
                            ("dispersions", name),
                        )
                    ]
                )
    return tuple(found.values())
