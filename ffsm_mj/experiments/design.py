"""Design of a campaign: sampled values of all runs, computed once and written before the first run."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Annotated, Any, Literal
from zlib import crc32

import numpy as np
from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

from ffsm_mj.arrays import FloatArray
from ffsm_mj.config import Cell, first_fault
from ffsm_mj.errors import Fault, Faults, InputError, ScenarioFaults
from ffsm_mj.experiments.distributions import Dispersion, Operation, SampledScalar, sampled_scalars
from ffsm_mj.experiments.file import CampaignFile, Kind

EXTENDABLE = ("random", "sobol")
"""Kinds of samples whose first rows do not depend on the number of samples."""


def unit_cube_points(kind: str, n: int, seed: int, names: Sequence[str], levels: Sequence[int] = ()) -> FloatArray:
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


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


@dataclass(frozen=True)
class Binding:
    """A key of the scenario that every run sets.

    Attributes:
        key: Dotted key, with positions for items of lists.
        base: Plain value without dispersions, lists as tuples; None if there is none.
        effects: Operations of the samples on the value, in order.
    """

    key: str
    base: Annotated[Any, AfterValidator(_tuples)]
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
        format: Version of the file.
    """

    kind: Kind
    seed: int
    n: Annotated[int, Field(ge=1)]
    parameters: tuple[str, ...]
    rows: tuple[tuple[Cell | tuple[Cell, ...], ...], ...]
    bindings: tuple[Binding, ...]
    format: Literal[1] = 1

    def overrides(self, run: int) -> dict[str, Any]:
        """Values (numbers, texts, lists of numbers) by dotted key of the scenario for a run, counted from 0."""
        values = {}
        for binding in self.bindings:
            value = binding.base
            for effect in binding.effects:
                value = effect.applied(value, self.rows[run])
            values[binding.key] = value
        return values

    def to_json(self) -> str:
        """JSON text for :meth:`from_json`; numbers are preserved bit for bit."""
        head = {"format": self.format, "kind": self.kind, "seed": self.seed, "n": self.n, "parameters": self.parameters}
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
            design = TypeAdapter(Design).validate_json(text, strict=True)
        except ValidationError as error:
            raise InputError(f"not a design of a campaign ({first_fault(error)})") from error
        if fault := _fault(design):
            raise InputError(f"not a design of a campaign ({fault})")
        return design


def _fault(design: Design) -> str:
    """What is wrong with a design of unknown origin whose values have the right types; empty if it is valid."""
    effects = [(binding.base, effect) for binding in design.bindings for effect in binding.effects]
    if any(len(row) != len(design.parameters) for row in design.rows):
        return "the number of values in a row differs from the number of parameters"
    if not all(_can_be_applied(effect, len(design.parameters)) for _, effect in effects):
        return "an effect cannot be applied"
    whole = {
        effect.columns[0]
        for base, effect in effects
        if effect.operation == "value" and isinstance(base, tuple) and not effect.at and effect.span is None
    }
    if any(isinstance(value, tuple) and i not in whole for row in design.rows for i, value in enumerate(row)):
        return "a list of numbers does not replace a list"
    return ""


def _can_be_applied(effect: ValueOperation, width: int) -> bool:
    axis, span, columns = effect.axis, effect.span, effect.columns
    return (
        len(columns) in (1, 3)
        and all(0 <= column < width for column in columns)
        and (axis is None or any(axis))
        and (span is None or axis is not None or len(columns) == 3)
    )


_MOST_ROWS = 10_000_000
"""A design is one list in memory, and one file: some gigabytes."""


def sample_design(
    kind: Kind, n: int, seed: int, sampled_scalars: Sequence[SampledScalar], bindings: Sequence[Binding]
) -> Design:
    """Sample the design of a campaign; equal arguments give equal designs.

    For kinds of samples that can be extended, the first rows do not depend on n.

    Raises:
        ScenarioFaults: A distribution exceeds the range of floating-point numbers.
    """
    names = tuple(scalar.name for scalar in sampled_scalars)
    levels = [len(scalar.distribution.levels or ()) for scalar in sampled_scalars]
    points = unit_cube_points(kind, n, seed, names, levels)
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
    kind = config.samples.kind
    grid, columns = kind == "grid", 0
    rows = 1 if grid else (config.samples.n or 1)
    with Faults() as faults:
        for name, dispersion in config.dispersions.items():
            for scalar in sampled_scalars(name, dispersion):
                columns += 1
                levels = scalar.distribution.levels
                if grid and levels is None:
                    faults.add("has no levels for a grid; write values, choice or grid", "dispersions", name)
                    break
                if not grid and scalar.distribution.grid is not None:
                    message = f"has levels of a grid, but the samples are of kind {kind}; write values or uniform"
                    faults.add(message, "dispersions", name)
                rows *= len(levels or ()) if grid else 1
        if kind == "saltelli":
            rows *= columns + 2
        if not faults.collected and rows > _MOST_ROWS:
            faults.add(f"gives {rows} runs; at most {_MOST_ROWS}", "samples")


def scalars_of(dispersions: Mapping[str, Dispersion]) -> tuple[SampledScalar, ...]:
    """Scalars sampled for each run, in the order of the file.

    Raises:
        ScenarioFaults: Two scalars have the same name, or the same stream of random numbers.
    """
    scalars: dict[int, SampledScalar] = {}
    for name, dispersion in dispersions.items():
        for scalar in sampled_scalars(name, dispersion):
            other = scalars.setdefault(crc32(scalar.name.encode()), scalar)
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
    return tuple(scalars.values())
