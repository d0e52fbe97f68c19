"""Residuals of the balances row by row, and the scale of the terms that cancel in them.

Rows are processed in blocks and not stored, so that the length of a run is not limited.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from ffsm_mj.arrays import FloatArray, IntArray
from ffsm_mj.balance.subsystems import energy_balance_residual, momentum_balance_residual
from ffsm_mj.records.metadata import free_components, orbit_rate
from ffsm_mj.records.signals import (
    COMPONENTS,
    CONTACT_WORK,
    DAMPER_HEAT,
    ELASTIC,
    OBJECTS_WORK,
    POTENTIAL,
    SLIDING_HEAT,
    SPRING_TRUNCATION,
    SUBSYSTEMS,
    Layout,
    momentum_keys,
)
from ffsm_mj.verification.check_result import share_of

DRIFT_WINDOW_STEPS = 100_000
"""Number of steps over which a residual may change by the tolerance of a check."""

# External impulses that exist only in scenes with fixed bodies, gravity or fields.
_OUTSIDE = ("fixed", "gravity", "field")


def drift_window_s(metadata: Mapping[str, str]) -> float:
    """Length of a window in s; infinite if the log does not give its step."""
    return DRIFT_WINDOW_STEPS * float(metadata.get("time_step_s", "inf"))


class BalanceColumns:
    """Columns of one subsystem from which its residuals are computed."""

    def __init__(self, layout: Layout, metadata: Mapping[str, str], subsystem: str) -> None:
        """Find the columns."""
        self._subsystem, self._free = subsystem, free_components(metadata, subsystem)
        self._momenta = {p: layout.places(momentum_keys(p)) for p in SUBSYSTEMS}
        there = [name for name in _OUTSIDE if f"balance.{name}_on_robot_{COMPONENTS[0]}" in layout.index]
        self._external, self._contact = (
            layout.places(f"balance.{account}_{component}" for component in COMPONENTS)
            for account in ("external", "contact")
        )
        self._outside = [
            layout.places(f"balance.{name}_on_{of}_{component}" for of in SUBSYSTEMS[1:] for component in COMPONENTS)
            for name in there
        ]
        self._energy, self._work = layout.index[f"energy.{subsystem}_J"], layout.index["balance.work_J"]
        self._gained = layout.index[f"balance.{subsystem}_impact_energy_J"]
        works = (layout.index.get(f"balance.{subsystem}_{name}_work_J") for name in _OUTSIDE[1:])
        self._outside_work = [i for i in works if i is not None]
        elastic_and_heat = [
            layout.index.get(f"energy.{ELASTIC.format(subsystem)}"),
            layout.index.get(f"balance.{DAMPER_HEAT.format(subsystem)}"),
        ]
        self._elastic_and_heat = [i for i in elastic_and_heat if i is not None]
        self._truncation = layout.index.get(f"balance.{SPRING_TRUNCATION.format(subsystem)}")
        self._energies = [
            i
            for i in (
                self._work if subsystem != "objects" else None,
                self._gained,
                *self._outside_work,
                *self._elastic_and_heat,
            )
            if i is not None
        ]
        on_robot, on_objects = ([part[k : k + 6] for part in self._outside] for k in (0, 6))
        self._impulses = {
            "total": [self._external, *on_robot, *on_objects],
            "robot": [self._external, self._contact, *on_robot],
            "objects": [self._contact, *on_objects],
        }[subsystem]
        self._objects_work = layout.index.get(f"balance.{OBJECTS_WORK}") if subsystem != "robot" else None
        self._on_objects: IntArray | None = None
        if self._objects_work is not None:
            self._on_objects = layout.places(f"balance.external_on_objects_{component}" for component in COMPONENTS)
            self._energies.append(self._objects_work)
            self._impulses.append(self._on_objects)
        prefix = "state.q_robot_" if subsystem == "robot" else "state.q_"
        self._places = [i for i, s in enumerate(layout.signals) if s.unit == "m" and s.key.startswith(prefix)]

    def energy(self, block: FloatArray) -> FloatArray:
        """T plus elastic energy and heat of dampers, less work and energy gained in impacts and from outside, J, (n,).

        It is constant for an exact balance.
        """
        energy, work, gained = (block[:, i] for i in (self._energy, self._work, self._gained))
        for i in self._outside_work:
            gained = gained + block[:, i]
        if self._objects_work is not None:
            gained = gained + block[:, self._objects_work]
        for i in self._elastic_and_heat:
            gained = gained - block[:, i]
        return energy_balance_residual(self._subsystem, energy, work, gained)

    def truncation(self, block: FloatArray) -> FloatArray | None:
        """Energy that RK4 has taken from the modes of joint springs, J, (n,); None without springs."""
        return block[:, self._truncation] if self._truncation is not None else None

    def momentum(self, block: FloatArray) -> FloatArray:
        """(P, L) less impulses on the free components, N s and N m s, (n, 6): constant for an exact balance."""
        momenta, external, contact = (block[:, i] for i in (self._momenta[self._subsystem], self._external, self._contact))
        outside = (
            np.sum([block[:, places] for places in self._outside], axis=0) if self._outside else np.zeros((len(block), 12))
        )
        if self._on_objects is not None:
            outside = outside + np.pad(block[:, self._on_objects], ((0, 0), (6, 0)))
        return momentum_balance_residual(self._subsystem, momenta, external, contact, outside, self._free)

    def scales(self, block: FloatArray) -> FloatArray:
        """Largest of the terms that cancel in energy, P and L: J, N s and N m s, (n, 3).

        These are the current kinetic energy and momenta and the accumulated terms: if a fixed body supports a weight, or an
        actuator pushes against a contact, the accumulated impulses grow while nothing moves.
        """
        energies = np.abs(block[:, [self._energy, *self._energies]]).max(axis=1)
        lever, linear, angular = norms(block[:, self._places]), [self.linear_scale(block)], [self.angular_scale(block)]
        for places in self._impulses:
            impulse = block[:, places] * self._free
            linear.append(norms(impulse[:, :3]))
            angular.append(norms(impulse[:, 3:]) + lever * linear[-1])
        return np.stack((energies, np.max(linear, axis=0), np.max(angular, axis=0)), axis=1)

    def linear_scale(self, block: FloatArray) -> FloatArray:
        """Sum of the norms of P of the parts of the subsystem, N s, (n,), which cancel in the whole system's P."""
        members = SUBSYSTEMS[1:] if self._subsystem == "total" else (self._subsystem,)
        return np.asarray(sum(norms(block[:, self._momenta[member]][:, :3]) for member in members))

    def angular_scale(self, block: FloatArray) -> FloatArray:
        """Norm of L + lever times norm of P, N m s, (n,): L about the origin is spin plus r x P, terms that cancel.

        The lever r is the norm of all coordinates of the subsystem's joints that are lengths, in m.
        """
        lever = norms(block[:, self._places])
        return np.asarray(norms(block[:, self._momenta[self._subsystem]][:, 3:]) + lever * self.linear_scale(block))


def norms(vectors: FloatArray) -> FloatArray:
    """Euclidean norm of each row, (n,), summed term by term so that its digits do not depend on the size of the block."""
    total = np.zeros(len(vectors))
    for column in vectors.T:
        total += column * column
    return np.sqrt(total)


def without_loss(change: FloatArray, loss: FloatArray) -> FloatArray:
    """Changes of energies, J, without what is known to have been taken: those that are lower by at most that are zero."""
    return change + np.clip(-change, 0.0, np.maximum(loss, 0.0))


class Peak:
    """Largest of a sequence of vectors, with time and component; independent of the division into blocks.

    Attributes:
        size: Norm of the vector.
        time_s: Time of the vector.
        component: Index of its largest component.
        scale: Largest scale so far.
    """

    def __init__(self, scale: float = 0.0) -> None:
        """Start without vectors."""
        self.size, self.time_s, self.component, self.scale = 0.0, math.nan, 0, scale

    def add(self, times: FloatArray, vectors: FloatArray, scale: FloatArray) -> None:
        """Process vectors: times (n,), vectors (n, number of components), scale (n,)."""
        sizes = norms(vectors)
        at = int(np.argmax(np.where(np.isnan(sizes), np.inf, sizes)))
        if math.isnan(self.time_s) or share_of(float(sizes[at]), 1.0) > share_of(self.size, 1.0):
            self.size, self.time_s = float(sizes[at]), float(times[at])
            self.component = int(np.argmax(np.abs(np.nan_to_num(vectors[at], nan=np.inf))))
        self.scale = float(np.maximum(self.scale, np.max(scale)))

    @property
    def rank(self) -> float:
        """Size over (1 + scale); infinite if it is not a number."""
        return share_of(self.size, 1.0 + self.scale)


class ResidualDrift:
    """Tracks a residual through a run by windows, each relative to the last row of the previous one.

    Attributes:
        drift: Largest norm of its change since the first row.
    """

    def __init__(self, length_s: float) -> None:
        """Set the length of a window in s."""
        self._length, self._window = length_s, 0.0
        self._first: FloatArray | None = None
        self._loss_before = 0.0
        self._done: Peak | None = None
        self._recent = Peak()
        self.drift = 0.0

    def add(self, times: FloatArray, residual: FloatArray, scale: FloatArray, loss: FloatArray | None = None) -> None:
        """Process rows.

        Args:
            times: Times, s, (n,).
            residual: Residuals, (n, number of components).
            scale: Their scales, (n,).
            loss: What the truncation of the step is known to have cost since t = 0, (n,): a residual that is so much
                lower is none. None: nothing is known.
        """
        if self._first is None:
            # Relative to the first row: the balances start at t = 0, but a damaged log may start later.
            self._first = self._base = self._last = residual[0].copy()
            self._loss_before = float(loss[0]) if loss is not None else 0.0
        if loss is not None:
            residual = self._first + without_loss(residual - self._first, (loss - self._loss_before)[:, None])
        self.drift = max(self.drift, float(np.fmax.reduce(norms(residual - self._first), initial=0.0)))
        # A row at the end of a window belongs to it; the rounding of time is far below a billionth of a window.
        windows = np.maximum(np.ceil(times / self._length - 1e-9), 1.0)
        edges = np.flatnonzero(np.diff(windows)) + 1
        for start, stop in pairwise([0, *edges.tolist(), len(times)]):
            if windows[start] != self._window:
                self._begin(float(windows[start]))
            self._recent.add(times[start:stop], residual[start:stop] - self._base, scale[start:stop])
            self._last = residual[stop - 1].copy()

    def _begin(self, window: float) -> None:
        if self._window:
            self._done, self._recent = self.worst, Peak(self._recent.scale)
        self._window, self._base = window, self._last

    @property
    def worst(self) -> Peak:
        """Peak of the window whose peak is largest relative to the scale up to its end."""
        return self._recent if self._done is None or self._recent.rank > self._done.rank else self._done


class JacobiCheck:
    """Residuals of the Jacobi integral of a circular orbit from blocks of rows.

    With n the rate of the orbit, T - n.L + U is constant but for what is not the field's. So are, by the balances of T and
    L, the work of the field less n times its angular impulse, plus its potential U: two ways to the same field, of which the
    potential is a function of the state alone.
    """

    def __init__(self, layout: Layout, metadata: Mapping[str, str]) -> None:
        """Find the columns; there are none without a circular orbit that is the only field."""
        self._rate, self._time, self._drift = orbit_rate(metadata), layout.time, ResidualDrift(drift_window_s(metadata))
        self._potential = layout.index.get(f"orbit.{POTENTIAL}") if self._rate is not None else None
        if self._potential is not None:
            self._work = layout.index["balance.total_field_work_J"]
            self._moments = [
                layout.places(f"balance.field_on_{of}_{component}" for component in COMPONENTS[3:]) for of in SUBSYSTEMS[1:]
            ]

    def rows(self, block: FloatArray) -> None:
        """Process the next rows, (n, columns)."""
        if self._potential is None or self._rate is None:
            return
        potential, work = block[:, self._potential], block[:, self._work]
        moment = (block[:, self._moments[0]] + block[:, self._moments[1]]) @ self._rate
        residual = potential + work - moment
        self._drift.add(block[:, self._time], residual[:, None], np.abs(np.stack((potential, work, moment))).max(axis=0))

    @property
    def worst(self) -> tuple[Peak, float] | None:
        """The worst residual and the largest since the first row, J; None without such an orbit."""
        return (self._drift.worst, self._drift.drift) if self._potential is not None else None


class HeatCheck:
    """Residuals of the heat of sliding from blocks of rows.

    There are two. The work of the contact forces and the heat add up to zero: normal forces do no work where gaps stay
    zero, nor does friction where points stick. The heat of a rule does not fall below its largest value so far. Work is
    summed from all generalised contact forces and velocities, heat from friction forces and slip.
    """

    def __init__(self, layout: Layout, window_s: float) -> None:
        """Find the columns; there are none in runs without friction."""
        keys = [key for key in layout.keys if key.startswith("contact.") and key.endswith(SLIDING_HEAT)]
        self._heat, self._work = layout.places(keys), layout.index.get(f"balance.{CONTACT_WORK}")
        self._time, self._largest = layout.time, np.full(len(keys), -np.inf)
        self._residual = ResidualDrift(window_s)

    def rows(self, block: FloatArray, added: FloatArray) -> None:
        """Process the next rows.

        Args:
            block: Rows, (n, columns).
            added: To the sum of work and heat in these rows, J, (n,).
        """
        if self._work is None or not len(self._heat):
            return
        heat, work = block[:, self._heat], block[:, self._work]
        total = heat.sum(axis=1)
        largest = np.maximum.accumulate(np.vstack((self._largest, heat)))[1:]
        self._largest = largest[-1]
        residual = np.stack((work + total + added, (largest - heat).max(axis=1)), axis=1)
        self._residual.add(block[:, self._time], residual, np.maximum(np.abs(work), np.abs(heat).max(axis=1)))

    @property
    def worst(self) -> Peak | None:
        """The worst residual in J: component 0 is energy without heat, 1 heat that falls; None if there was no contact."""
        worst = self._residual.worst
        return worst if worst.scale > 0.0 or worst.size > 0.0 else None

    @property
    def drift(self) -> float:
        """Largest residual since the first row, J."""
        return self._residual.drift
