"""The design of a campaign: every run's values, drawn once, written before the first run and never drawn again."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from ffsm_mj.campaign.effects import Effect
from ffsm_mj.errors import InputError

_FORMAT = 1


@dataclass(frozen=True)
class Binding:
    """A key of the scenario that every run sets.

    Attributes:
        key: Dotted, positions for items of lists.
        base: Plain value that it has without dispersions; lists as tuples. None where it has none.
        effects: What the run's draws do to it, one after the other.
    """

    key: str
    base: Any
    effects: tuple[Effect, ...]


@dataclass(frozen=True)
class Design:
    """What is drawn for every run, and what that means for its scenario.

    Attributes:
        kind: Kind of samples.
        seed: Root of all chance.
        n: Size of the sample: the rows, of ``saltelli`` rows / (d + 2).
        parameters: Names of what is drawn, columns of the table.
        rows: By run, the drawn values.
        bindings: Keys of the scenario that are set.
    """

    kind: str
    seed: int
    n: int
    parameters: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]
    bindings: tuple[Binding, ...]

    def overrides(self, run: int) -> dict[str, Any]:
        """Dotted keys of the scenario and their plain values (numbers, texts, lists of numbers) of a run, from 0."""
        found = {}
        for binding in self.bindings:
            value = binding.base
            for effect in binding.effects:
                value = effect.applied(value, self.rows[run])
            found[binding.key] = value
        return found

    def to_json(self) -> str:
        """Text that :meth:`from_json` reads; numbers come back bit by bit."""
        head = {"format": _FORMAT, "kind": self.kind, "seed": self.seed, "n": self.n, "parameters": self.parameters}
        lines = [f'"{key}": {json.dumps(value)}' for key, value in head.items()]
        for key, items in (("bindings", [asdict(binding) for binding in self.bindings]), ("rows", self.rows)):
            lines.append(f'"{key}": [\n' + ",\n".join(map(json.dumps, items)) + "\n]")
        return "{\n" + ",\n".join(lines) + "\n}\n"

    @classmethod
    def from_json(cls, text: str) -> Design:
        """The design that was written.

        Raises:
            InputError: It is none, or of another version.
        """
        try:
            data = json.loads(text)
            if data["format"] != _FORMAT:
                raise InputError(f"a design of format {data['format']}; this version reads {_FORMAT}")
            bindings = tuple(
                Binding(b["key"], _tuples(b["base"]), tuple(Effect(**_tuples(effect)) for effect in b["effects"]))
                for b in data["bindings"]
            )
            rows = tuple(map(tuple, data["rows"]))
            return cls(data["kind"], data["seed"], data["n"], tuple(data["parameters"]), rows, bindings)
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"no design of a campaign ({type(error).__name__}: {error})") from error


def _tuples(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
