"""What the balance says of samples: balances, and the signals that they fill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import accumulate

import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.records.signals import COMPONENTS, SUBSYSTEMS, Signal, unit_of

ACCOUNTS = 43
"""How many numbers all accounts have."""


@dataclass(frozen=True)
class BalanceTerms:
    """What was booked since t = 0, now or at n samples.

    Attributes:
        work: Of the actuators, J, (..., 1).
        gained: Kinetic energy gained in impacts by (total, robot, objects), J, (..., 3).
        external: Impulse (P, L about the origin) of base actuators on the robot, (..., 6).
        contact: Impulse of the robot on the objects, (..., 6).
        fixed: Impulse of fixed bodies on the robot and on the objects, (..., 12).
        fallen: Work of gravity on (total, robot, objects), J, (..., 3).
        gravity: Impulse of gravity on the robot and on the objects, (..., 12).
    """

    work: FloatArray
    gained: FloatArray
    external: FloatArray
    contact: FloatArray
    fixed: FloatArray
    fallen: FloatArray
    gravity: FloatArray

    @classmethod
    def of(cls, numbers: FloatArray) -> BalanceTerms:
        """Views of the numbers of all accounts, (..., ACCOUNTS)."""
        return cls(*np.split(numbers, (1, 4, 10, 16, 28, 31), axis=-1))

    def take(self, other: BalanceTerms) -> None:
        """Take over the numbers of other accounts."""
        for account in fields(BalanceTerms):
            getattr(self, account.name)[:] = getattr(other, account.name)


@dataclass(frozen=True)
class BalanceValues:
    """What the balance says of n samples; see the signals below.

    Attributes:
        energy: By subsystem, (n, 3).
        momentum: By subsystem, (n, 3, 6).
        by_mass_matrix: Of the robot, (n, 6).
        accounts: What was booked.
        energy_residual: By subsystem, (n, 3).
        momentum_residual: By subsystem, (n, 3, 6).
    """

    energy: FloatArray
    momentum: FloatArray
    by_mass_matrix: FloatArray
    accounts: BalanceTerms
    energy_residual: FloatArray
    momentum_residual: FloatArray


@dataclass(frozen=True)
class _SignalGroup:
    """Signals of the balance, and what of a balance fills them, (n, number of signals) once it is flat."""

    signals: tuple[Signal, ...]
    of: Callable[[BalanceValues], FloatArray]


def _by_party(group: str, name: str, meaning: str) -> tuple[Signal, ...]:
    return tuple(Signal(group, name.format(subsystem), "J", f"{meaning}, {subsystem}") for subsystem in SUBSYSTEMS)


def _components(group: str, name: str, meaning: str) -> tuple[Signal, ...]:
    return tuple(Signal(group, f"{name}_{component}", unit_of(component), meaning) for component in COMPONENTS)


_BY_MATRIX = "momentum of the robot from the base rows of M qdot, paper (8)-(9); zero where the base joints are not free"
_LEFT = "momentum - momentum(0) - impulses, {}; zero where the base joints are not free"

_FIXED = "impulse of fixed bodies on the {}"
_GRAVITY = "impulse of gravity on the {}"
_OPTIONAL = {"fixed": 12, "fallen": 3, "gravity": 12}

_ENTRIES = {
    "energy": _SignalGroup(_by_party("energy", "{}_J", "kinetic energy"), lambda b: b.energy),
    "momentum": _SignalGroup(
        tuple(
            s
            for subsystem in SUBSYSTEMS
            for s in _components("momentum", subsystem, f"momentum, {subsystem}, summed body by body")
        ),
        lambda b: b.momentum,
    ),
    "by_mass_matrix": _SignalGroup(_components("momentum", "robot_by_mass_matrix", _BY_MATRIX), lambda b: b.by_mass_matrix),
    "work": _SignalGroup((Signal("balance", "work_J", "J", "work of the actuators"),), lambda b: b.accounts.work),
    "gained": _SignalGroup(
        _by_party("balance", "{}_impact_energy_J", "kinetic energy gained in impacts"), lambda b: b.accounts.gained
    ),
    "external": _SignalGroup(
        _components("balance", "external", "impulse of base actuators on the robot"), lambda b: b.accounts.external
    ),
    "contact": _SignalGroup(
        _components("balance", "contact", "impulse of contacts on the objects"), lambda b: b.accounts.contact
    ),
    "fixed": _SignalGroup(
        tuple(
            s
            for subsystem in SUBSYSTEMS[1:]
            for s in _components("balance", f"fixed_on_{subsystem}", _FIXED.format(subsystem))
        ),
        lambda b: b.accounts.fixed,
    ),
    "fallen": _SignalGroup(_by_party("balance", "{}_gravity_work_J", "work of gravity"), lambda b: b.accounts.fallen),
    "gravity": _SignalGroup(
        tuple(
            s
            for subsystem in SUBSYSTEMS[1:]
            for s in _components("balance", f"gravity_on_{subsystem}", _GRAVITY.format(subsystem))
        ),
        lambda b: b.accounts.gravity,
    ),
    "energy_residual": _SignalGroup(
        _by_party("balance", "{}_energy_residual_J", "T - T(0) - work - impact energy"), lambda b: b.energy_residual
    ),
    "momentum_residual": _SignalGroup(
        tuple(
            s for subsystem in SUBSYSTEMS for s in _components("balance", f"{subsystem}_residual", _LEFT.format(subsystem))
        ),
        lambda b: b.momentum_residual,
    ),
}


class BalanceSignals:
    """What the balance of a scene says, in columns.

    Attributes:
        signals: The columns; those of fixed bodies and of gravity are there where the scene has them.
    """

    def __init__(self, *, fixed: bool, gravity: bool) -> None:
        """Say whether the scene has fixed bodies, and gravity."""
        present = {"fixed": fixed, "fallen": gravity, "gravity": gravity}
        self._entries = {name: entry for name, entry in _ENTRIES.items() if present.get(name, True)}
        self.signals = tuple(signal for entry in self._entries.values() for signal in entry.signals)
        self._ends = tuple(accumulate(len(entry.signals) for entry in self._entries.values()))

    def values(self, balance: BalanceValues) -> FloatArray:
        """Values of all signals, (n, number of signals)."""
        parts = (entry.of(balance) for entry in self._entries.values())
        return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)

    def balance(self, told: FloatArray) -> BalanceValues:
        """The balance of samples whose signals have these values, (n, number of signals)."""
        parts = dict(zip(self._entries, np.split(told, self._ends[:-1], axis=1), strict=True))
        parts = {name: np.zeros((len(told), size)) for name, size in _OPTIONAL.items()} | parts
        accounts = BalanceTerms(*(parts[account.name] for account in fields(BalanceTerms)))
        by_party = {name: parts[name].reshape(-1, 3, 6) for name in ("momentum", "momentum_residual")}
        return BalanceValues(
            parts["energy"],
            by_party["momentum"],
            parts["by_mass_matrix"],
            accounts,
            parts["energy_residual"],
            by_party["momentum_residual"],
        )
