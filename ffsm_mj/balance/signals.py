"""Terms of the balance, its values at samples, the signals that log them, and what they are computed from.

That is copied from MuJoCo's arrays at each sample; the balance of a block of samples is computed at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import accumulate
from typing import Any

import numpy as np

from ffsm_mj._core.tick import Collect, Sampler
from ffsm_mj.arrays import FloatArray
from ffsm_mj.dynamics.rigid_body import subtree_momenta
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import (
    COMPONENTS,
    DAMPER_HEAT,
    ELASTIC,
    OBJECTS_WORK,
    SPRING_TRUNCATION,
    SUBSYSTEMS,
    Signal,
    unit_of,
)

ACCOUNTS = 74
"""Number of scalar terms in a balance."""
_BY_MATRIX = "momentum of the robot from the base rows of M qdot, paper (8)-(9); zero where the base joints are not free"
_RESIDUAL = "momentum - momentum(0) - impulses, {}; zero where the base joints are not free"
_FIXED = "impulse of fixed bodies on the {}"
_GRAVITY = "impulse of gravity on the {}"
_FIELD = "impulse of external fields on the {}"
_OPTIONAL = {
    "fixed": 12,
    "fallen": 3,
    "gravity": 12,
    "elastic": 3,
    "heat": 3,
    "truncation": 3,
    "objects_work": 1,
    "objects_external": 6,
    "field_work": 3,
    "field": 12,
}


@dataclass(frozen=True)
class BalanceTerms:
    """Terms of the balance accumulated since t = 0, now or at n samples.

    Attributes:
        work: Work of the actuators of the robot, J, (..., 1).
        gained: Kinetic energy gained in impacts by (total, robot, objects), J, (..., 3).
        external: Impulse (P, L about the origin) of base actuators on the robot, (..., 6).
        contact: Impulse of the robot on the objects, (..., 6).
        fixed: Impulse of fixed bodies on the robot and on the objects, (..., 12).
        fallen: Work of gravity on (total, robot, objects), J, (..., 3).
        gravity: Impulse of gravity on the robot and on the objects, (..., 12).
        elastic: Elastic energy of the joint springs of (total, robot, objects), J, (..., 3).
        heat: Heat of the joint dampers of (total, robot, objects), J, (..., 3).
        truncation: Energy that the truncation of RK4 takes from the modes of springs, by subsystem, J, (..., 3).
        objects_work: Work of the actuators of the objects, J, (..., 1).
        objects_external: Impulse (P, L about the origin) of base actuators of the objects on them, (..., 6).
        field_work: Work of external fields on (total, robot, objects), J, (..., 3).
        field: Impulse of external fields on the robot and on the objects, (..., 12).
    """

    work: FloatArray
    gained: FloatArray
    external: FloatArray
    contact: FloatArray
    fixed: FloatArray
    fallen: FloatArray
    gravity: FloatArray
    elastic: FloatArray
    heat: FloatArray
    truncation: FloatArray
    objects_work: FloatArray
    objects_external: FloatArray
    field_work: FloatArray
    field: FloatArray

    @classmethod
    def of(cls, numbers: FloatArray) -> BalanceTerms:
        """Views of an array of all terms, (..., ACCOUNTS)."""
        return cls(*np.split(numbers, (1, 4, 10, 16, 28, 31, 43, 46, 49, 52, 53, 59, 62), axis=-1))

    def take(self, other: BalanceTerms) -> None:
        """Copy the values of another set of terms."""
        for account in fields(BalanceTerms):
            getattr(self, account.name)[:] = getattr(other, account.name)


@dataclass(frozen=True)
class BalanceValues:
    """Energies, momenta, balance terms and residuals of n samples; see the signals below.

    Attributes:
        energy: By subsystem, (n, 3).
        momentum: By subsystem, (n, 3, 6).
        by_mass_matrix: Momentum of the robot from the base rows of M qdot, (n, 6).
        accounts: Terms of the balance.
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
    """Signals of the balance, and the function that selects their values, (n, number of signals) when flattened."""

    signals: tuple[Signal, ...]
    of: Callable[[BalanceValues], FloatArray]


def _by_subsystem(group: str, name: str, meaning: str) -> tuple[Signal, ...]:
    return tuple(Signal(group, name.format(subsystem), "J", f"{meaning}, {subsystem}") for subsystem in SUBSYSTEMS)


def _components(group: str, name: str, meaning: str) -> tuple[Signal, ...]:
    return tuple(Signal(group, f"{name}_{component}", unit_of(component), meaning) for component in COMPONENTS)


def _on_subsystems(name: str, meaning: str) -> tuple[Signal, ...]:
    """Components of what acts on the robot and on the objects."""
    parts = [_components("balance", f"{name}_{subsystem}", meaning.format(subsystem)) for subsystem in SUBSYSTEMS[1:]]
    return parts[0] + parts[1]


_ENTRIES = {
    "energy": _SignalGroup(_by_subsystem("energy", "{}_J", "kinetic energy"), lambda b: b.energy),
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
        _by_subsystem("balance", "{}_impact_energy_J", "kinetic energy gained in impacts"), lambda b: b.accounts.gained
    ),
    "external": _SignalGroup(
        _components("balance", "external", "impulse of base actuators on the robot"), lambda b: b.accounts.external
    ),
    "contact": _SignalGroup(
        _components("balance", "contact", "impulse of contacts on the objects"), lambda b: b.accounts.contact
    ),
    "fixed": _SignalGroup(_on_subsystems("fixed_on", _FIXED), lambda b: b.accounts.fixed),
    "fallen": _SignalGroup(_by_subsystem("balance", "{}_gravity_work_J", "work of gravity"), lambda b: b.accounts.fallen),
    "gravity": _SignalGroup(_on_subsystems("gravity_on", _GRAVITY), lambda b: b.accounts.gravity),
    "field_work": _SignalGroup(
        _by_subsystem("balance", "{}_field_work_J", "work of external fields"), lambda b: b.accounts.field_work
    ),
    "field": _SignalGroup(_on_subsystems("field_on", _FIELD), lambda b: b.accounts.field),
    "elastic": _SignalGroup(
        _by_subsystem("energy", ELASTIC, "elastic energy of joint springs"), lambda b: b.accounts.elastic
    ),
    "heat": _SignalGroup(_by_subsystem("balance", DAMPER_HEAT, "heat of joint dampers"), lambda b: b.accounts.heat),
    "truncation": _SignalGroup(
        _by_subsystem("balance", SPRING_TRUNCATION, "energy that RK4 takes from the modes of joint springs"),
        lambda b: b.accounts.truncation,
    ),
    "objects_work": _SignalGroup(
        (Signal("balance", OBJECTS_WORK, "J", "work of the actuators of the objects"),), lambda b: b.accounts.objects_work
    ),
    "objects_external": _SignalGroup(
        _components("balance", "external_on_objects", "impulse of base actuators of the objects on them"),
        lambda b: b.accounts.objects_external,
    ),
    "energy_residual": _SignalGroup(
        _by_subsystem("balance", "{}_energy_residual_J", "T - T(0) - work - impact energy"), lambda b: b.energy_residual
    ),
    "momentum_residual": _SignalGroup(
        tuple(
            s
            for subsystem in SUBSYSTEMS
            for s in _components("balance", f"{subsystem}_residual", _RESIDUAL.format(subsystem))
        ),
        lambda b: b.momentum_residual,
    ),
}


class BalanceSignals:
    """Columns of the balance of a scene.

    Attributes:
        signals: The columns; those of fixed bodies, gravity, fields, springs, dampers and actuators of objects only if the
            scene has them.
    """

    def __init__(self, *, fixed: bool, gravity: bool, springs: bool, dampers: bool, driven: bool, fields: bool) -> None:
        """Choose the columns for a scene with or without fixed bodies, gravity, springs, dampers, driven objects, fields."""
        present = {"fixed": fixed, "fallen": gravity, "gravity": gravity}
        present |= {"elastic": springs, "heat": dampers, "truncation": springs}
        present |= {"objects_work": driven, "objects_external": driven, "field_work": fields, "field": fields}
        self._entries = {name: entry for name, entry in _ENTRIES.items() if present.get(name, True)}
        self.signals = tuple(signal for entry in self._entries.values() for signal in entry.signals)
        self._ends = tuple(accumulate(len(entry.signals) for entry in self._entries.values()))

    def values(self, balance: BalanceValues) -> FloatArray:
        """Values of all signals, (n, number of signals)."""
        parts = (entry.of(balance) for entry in self._entries.values())
        return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)

    def balance(self, logged: FloatArray) -> BalanceValues:
        """The balance of samples from the values of their signals, (n, number of signals)."""
        parts = dict(zip(self._entries, np.split(logged, self._ends[:-1], axis=1), strict=True))
        parts = {name: np.zeros((len(logged), size)) for name, size in _OPTIONAL.items()} | parts
        accounts = BalanceTerms(*(parts[account.name] for account in fields(BalanceTerms)))
        by_subsystem = {name: parts[name].reshape(-1, 3, 6) for name in ("momentum", "momentum_residual")}
        return BalanceValues(
            parts["energy"],
            by_subsystem["momentum"],
            parts["by_mass_matrix"],
            accounts,
            parts["energy_residual"],
            by_subsystem["momentum_residual"],
        )


class SampledStates:
    """What the balance is computed from at n states: copies of MuJoCo's arrays and of the terms, views of one array.

    Attributes:
        trees: Velocity and place of the mass centre of each tree, and its angular momentum about that, (n, trees, 3, 3).
        jacp: Jacobians of the frame of the robot's base, (n, 3, nv).
        jacr: Their angular parts, (n, 3, nv).
        position: Positions of that frame, (n, 3), m.
        h: Generalised momenta, (n, nv).
        rates: Generalised velocities, (n, nv).
        accounts: Balance terms, then the values of the grasped object, (n, number of both).
    """

    def __init__(self, system: System, values: FloatArray) -> None:
        """Split the values, (n, numbers of a sample)."""
        self._system, shapes = system, self._shapes(system)
        parts = np.split(values, tuple(accumulate(map(math.prod, shapes))), axis=1)
        arrays = [part.reshape(-1, *shape) for part, shape in zip(parts, (*shapes, parts[-1].shape[1:]), strict=True)]
        self.trees, self.jacp, self.jacr, self.position, self.h, self.rates, self.accounts = arrays

    @staticmethod
    def _shapes(system: System) -> tuple[tuple[int, ...], ...]:
        nv = system.mj.nv
        return (len(system.trees), 3, 3), (3, nv), (3, nv), (3,), (nv,), (nv,)

    @classmethod
    def live(cls, system: System, data: Any, momentum: FloatArray, accounts: FloatArray) -> tuple[FloatArray, Collect]:
        """Array of the values of one state, and what brings it up to date.

        Args:
            system: Robot and objects.
            data: Their state.
            momentum: M qdot, kept current by the caller, (nv,).
            accounts: Balance terms, then the values of the grasped object, (number of both,).
        """
        values = np.zeros(sum(map(math.prod, cls._shapes(system))) + len(accounts))
        state, root = cls(system, values[None]), system.robot.root
        sampler = Sampler(system.mj, data, base=root)
        copies = [
            (array[tree.root], state.trees[:, number, k])
            for number, tree in enumerate(system.trees)
            for k, array in enumerate((data.subtree_linvel, data.subtree_com, data.subtree_angmom))
        ]
        copies += [(sampler.jacp, state.jacp), (sampler.jacr, state.jacr), (data.xpos[root], state.position)]
        copies += [(momentum, state.h), (data.qvel, state.rates), (accounts, state.accounts)]
        sampler.copy(copies)
        return values, Collect(sampler)

    def momenta(self, tree: int) -> FloatArray:
        """Momenta of a tree, the robot's first, (n, 6)."""
        mass = float(self._system.mj.body_subtreemass[self._system.trees[tree].root])
        return subtree_momenta(mass, *np.moveaxis(self.trees[:, tree], 1, 0))
