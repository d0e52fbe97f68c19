"""Everything that is logged once per control tick: names, units and meaning, in one order, for every reader and writer.

A row is one float64 vector. Its columns are named ``group.name``; the name ends in its unit. Vectors are in world axes,
angular momentum is about the world origin, quaternions are wxyz.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from ffsm_mj.model.system import Joint, System

# What each group holds, in the order of the row.
GROUPS = {
    "state": "generalised coordinates and velocities, and the tip",
    "energy": "kinetic energy",
    "momentum": "linear momentum P and angular momentum L about the world origin",
    "ledger": "accounts of work and impulse since t = 0, and what they leave unexplained",
    "actuators": "commanded and applied efforts, and their bounds",
    "controller": "what the controller reports of itself",
    "phase": "the phase of the task",
}

# The whole system, and the two parties of an impact.
PARTIES = ("total", "robot", "objects")
# Components of a momentum or wrench about the world origin, with units.
COMPONENTS = ("P_x_N_s", "P_y_N_s", "P_z_N_s", "L_x_N_m_s", "L_y_N_m_s", "L_z_N_m_s")

OVERLAP = "deepest_overlap_m"
"""Signal of the ledger that tells of penetration."""

_COORDINATES = {
    "free": ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"),
    "ball": ("qw", "qx", "qy", "qz"),
    "slide": ("m",),
    "hinge": ("rad",),
}
_RATES = {
    "free": ("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s"),
    "ball": ("wx_rad_s", "wy_rad_s", "wz_rad_s"),
    "slide": ("m_s",),
    "hinge": ("rad_s",),
}


@dataclass(frozen=True)
class Signal:
    """One logged scalar: the group it belongs to, its name (ends in the unit), its unit and what it means."""

    group: str
    name: str
    unit: str
    description: str

    @property
    def key(self) -> str:
        """Name by which users ask for it: ``group.name``."""
        return f"{self.group}.{self.name}"


@dataclass(frozen=True)
class Layout:
    """The columns of a row, in order."""

    signals: tuple[Signal, ...]

    @cached_property
    def index(self) -> dict[str, int]:
        """Column of each key."""
        return {signal.key: i for i, signal in enumerate(self.signals)}

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """All keys in column order."""
        return tuple(signal.key for signal in self.signals)

    def columns(self, first: str, count: int) -> slice:
        """Slice of ``count`` columns that starts at a key."""
        start = self.index[first]
        return slice(start, start + count)


def identifier(name: str) -> str:
    """A model's name as a field name: what is no letter, digit or underscore becomes an underscore."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def coordinate_names(joint: Joint) -> tuple[str, ...]:
    """Names of a joint's entries of ``qpos``, without the leading ``q_``."""
    return tuple(f"{identifier(joint.name)}_{suffix}" for suffix in _COORDINATES[joint.kind])


def rate_names(joint: Joint) -> tuple[str, ...]:
    """Names of a joint's entries of ``qvel``, without the leading ``v_``."""
    return tuple(f"{identifier(joint.name)}_{suffix}" for suffix in _RATES[joint.kind])


def build_layout(system: System, actuators: Sequence[Signal], telemetry: Sequence[Signal], *, tip: bool) -> Layout:
    """Columns of a run.

    Args:
        system: Gives the joints.
        actuators: Signals of the plant's actuation.
        telemetry: Signals of the controller.
        tip: Whether the scenario has a task and so a tip.
    """
    signals = [
        *_state_signals(system, tip=tip),
        *(Signal("energy", f"{party}_J", "J", f"kinetic energy, {party}") for party in PARTIES),
        *_momentum_signals(),
        *_ledger_signals(),
        *actuators,
        *telemetry,
        Signal("phase", "index", "", "position of the phase in the scenario, from 0"),
    ]
    return Layout(tuple(signals))


def _state_signals(system: System, *, tip: bool) -> Iterable[Signal]:
    joints = sorted(system.joints.values(), key=lambda joint: joint.qpos.start)
    yield Signal("state", "time_s", "s", "simulation time")
    for joint in joints:
        for name in coordinate_names(joint):
            yield Signal("state", f"q_{name}", unit_of(name), f"coordinate of {joint.kind} joint {joint.name}")
    for joint in joints:
        frame = ", linear part in world axes, angular part in body axes" if joint.kind == "free" else ""
        for name in rate_names(joint):
            yield Signal("state", f"v_{name}", unit_of(name), f"rate of {joint.kind} joint {joint.name}{frame}")
    if tip:
        for axis in "xyz":
            yield Signal("state", f"tip_{axis}_m", "m", "position of the tip")
        for axis in "xyz":
            yield Signal("state", f"tip_v{axis}_m_s", "m/s", "velocity of the tip")


def _momentum_signals() -> Iterable[Signal]:
    for party in PARTIES:
        for component in COMPONENTS:
            yield Signal("momentum", f"{party}_{component}", unit_of(component), f"momentum, {party}, summed body by body")
    for component in COMPONENTS:
        yield Signal(
            "momentum",
            f"robot_by_mass_matrix_{component}",
            unit_of(component),
            "momentum of the robot from the base rows of M qdot, paper (8)-(9); zero where the base joints are not free",
        )


def _ledger_signals() -> Iterable[Signal]:
    yield Signal("ledger", "work_J", "J", "work of the actuators")
    for party in PARTIES:
        yield Signal("ledger", f"{party}_impact_energy_J", "J", f"kinetic energy gained in impacts, {party}")
    for component in COMPONENTS:
        yield Signal("ledger", f"external_{component}", unit_of(component), "impulse of base actuators on the robot")
    for component in COMPONENTS:
        yield Signal("ledger", f"contact_{component}", unit_of(component), "impulse of contacts on the objects")
    for party in PARTIES:
        yield Signal("ledger", f"{party}_energy_residual_J", "J", f"T - T(0) - work - impact energy, {party}")
    for party in PARTIES:
        for component in COMPONENTS:
            yield Signal(
                "ledger",
                f"{party}_residual_{component}",
                unit_of(component),
                f"momentum - momentum(0) - impulses, {party}; zero where the base joints are not free",
            )
    yield Signal(
        "ledger",
        OVERLAP,
        "m",
        "deepest overlap of an impact pair at the ends of the steps and sub-steps since the sample before",
    )


_UNITS = (("_N_m_s", "N m s"), ("_N_m", "N m"), ("_N_s", "N s"), ("_rad_s", "rad/s"), ("_m_s", "m/s"), ("_rad", "rad"))


def unit_of(name: str) -> str:
    """Unit that a name ends in; empty for a plain number."""
    for suffix, unit in (*_UNITS, ("_m", "m"), ("_N", "N"), ("_J", "J"), ("_s", "s")):
        if name.endswith(suffix):
            return unit
    return ""
