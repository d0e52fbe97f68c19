"""Design of a campaign: sampled values of all runs, computed once and written before the first run."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, get_args

from ffsm_mj.campaign.plan.dispersions import Operation
from ffsm_mj.campaign.plan.sampler import KINDS
from ffsm_mj.campaign.plan.value_operations import ValueOperation
from ffsm_mj.errors import InputError

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
