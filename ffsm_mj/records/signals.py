"""Signals that are logged once per control tick: names, units, descriptions and order.

A row is one float64 vector. Its columns are named ``group.name``; the name ends in its unit. Vectors are in world axes,
angular momentum is about the world origin, quaternions are wxyz.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from ffsm_mj.arrays import IntArray
from ffsm_mj.model.system import Joint

# Description of each group, in the order of the row.
GROUPS = {
    "state": "generalised coordinates and velocities, and the tip",
    "energy": "kinetic energy; elastic energy of joint springs, if there are any",
    "momentum": "linear momentum P and angular momentum L about the world origin",
    "balance": "accumulated work and impulses since t = 0, and residuals of energy and momenta",
    "orbit": "the reference orbit, and the bases of robot and objects in LVLH axes",
    "contact": "telemetry of the contact models",
    "actuators": "commanded and applied efforts, and their bounds",
    "sensor": "measurements as the control law is shown them, with their true values",
    "estimate": "state as the control law sees it, and its error",
    "controller": "telemetry of the controller",
    "phase": "the phase of the task",
    "clock": "wall time of a run in real time",
}

# The whole system, and the two subsystems of an impact.
SUBSYSTEMS = ("total", "robot", "objects")
# Components of a momentum or wrench about the world origin, with units.
COMPONENTS = ("P_x_N_s", "P_y_N_s", "P_z_N_s", "L_x_N_m_s", "L_y_N_m_s", "L_z_N_m_s")

POTENTIAL = "potential_J"
"""Signal of the potential of an orbit's field."""
TIME = "state.time_s"
"""Column of the simulation time."""
TIP = ("state.tip_x_m", "state.tip_y_m", "state.tip_z_m")
"""Columns of the tip's position, where there is a task."""
TARGET = ("state.target_x_m", "state.target_y_m", "state.target_z_m")
"""Columns of the target's position, where it moves."""
TIP_RATE = ("state.tip_vx_m_s", "state.tip_vy_m_s", "state.tip_vz_m_s")
"""Columns of its velocity."""
OVERLAP = "deepest_overlap_m"
"""Signal of the deepest penetration."""
LIMIT_OVERRUN = {"rad": "joint_limit_overrun_rad", "m": "joint_limit_overrun_m"}
"""Signals of the largest travel past a joint limit, by the unit of the joint's coordinate."""
PROJECTED = "projected_{}_J"
"""Signals of the energy that projections of the state change, of closed contacts and of closed loops."""
OBJECTS_WORK = "objects_work_J"
FRICTION_HEAT, CONTACT_WORK = "friction_heat_J", "contact_work_J"
"""Signals of the heat of friction at impacts and in persistent contact, and of the work of persistent contact forces."""
ELASTIC, DAMPER_HEAT, SPRING_TRUNCATION = "{}_elastic_J", "{}_damper_heat_J", "{}_spring_truncation_J"
"""Signals of the elastic energy of joint springs, the heat of joint dampers, and the energy that RK4 takes from the modes of
the springs, by subsystem."""
JOINT_FRICTION_HEAT = "{}_joint_friction_heat_J"
"""Signal of the heat of dry friction of joints, by subsystem."""
SLIDING_HEAT = "_heat_J"
"""End of the names of the signals of the heat of sliding of the contact rules with friction."""
LIMIT_FORCES = ("_limit_torque_N_m", "_limit_force_N")
"""Ends of the names of the signals of the forces of joint limits: of hinges, and of slides."""

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
    """One logged scalar.

    Attributes:
        group: Group of the signal, a key of ``GROUPS``.
        name: Name in the group, a letter followed by letters, digits and underscores; it ends in the unit.
        unit: Unit; empty for a dimensionless number.
        description: Meaning of the signal.
        element: Full name of the model element that its name derives from; empty if there is none.
    """

    group: str
    name: str
    unit: str
    description: str
    element: str = field(default="", compare=False)

    @cached_property
    def key(self) -> str:
        """Full name: ``group.name``."""
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

    @cached_property
    def time(self) -> int:
        """Column of the simulation time.

        Raises:
            KeyError: There is no such column.
        """
        return self.index[TIME]

    def places(self, keys: Iterable[str]) -> IntArray:
        """Columns of some keys, in their order.

        Raises:
            KeyError: One of them does not exist.
        """
        return np.array([self.index[key] for key in keys], dtype=np.intp)


@lru_cache(maxsize=4096)
def identifier(name: str) -> str:
    """A name of a model as a field name: other characters than letters, digits and underscores become underscores."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def limit_force_name(joint: str, unit: str) -> str:
    """Name of the signal of the force of a joint's limits, by the unit of its coordinate, ``rad`` or ``m``."""
    return identifier(joint) + LIMIT_FORCES[unit == "m"]


def coordinate_names(joint: Joint) -> tuple[str, ...]:
    """Names of a joint's entries of ``qpos``, without the leading ``q_``."""
    return tuple(f"{identifier(joint.name)}_{suffix}" for suffix in _COORDINATES[joint.kind])


def rate_names(joint: Joint) -> tuple[str, ...]:
    """Names of a joint's entries of ``qvel``, without the leading ``v_``."""
    return tuple(f"{identifier(joint.name)}_{suffix}" for suffix in _RATES[joint.kind])


def coordinate_keys(joints: Iterable[Joint]) -> tuple[str, ...]:
    """Columns of ``qpos`` for all joints, in the order of ``qpos``."""
    ordered = sorted(joints, key=lambda joint: joint.qpos.start)
    return tuple(f"state.q_{name}" for joint in ordered for name in coordinate_names(joint))


def rate_keys(joints: Iterable[Joint]) -> tuple[str, ...]:
    """Columns of ``qvel`` for all joints, in the order of ``qvel``."""
    ordered = sorted(joints, key=lambda joint: joint.dofs.start)
    return tuple(f"state.v_{name}" for joint in ordered for name in rate_names(joint))


def momentum_keys(whose: str) -> tuple[str, ...]:
    """Columns of a momentum (P, L about the world origin): of a subsystem, or ``robot_by_mass_matrix``."""
    return tuple(f"momentum.{whose}_{component}" for component in COMPONENTS)


def effort_key(layout: Layout, actuator: str, what: str) -> str:
    """Column of an actuator's effort, in N or N m (of a magnetorquer A m^2), or of a servo's setpoint, in that of its joint.

    Args:
        layout: Columns of a row.
        actuator: Its full name.
        what: ``command``, ``applied``, ``lower`` or ``upper``.

    Raises:
        KeyError: The log lacks it.
    """
    stem = f"actuators.{identifier(actuator)}_{what}"
    for suffix in _COMMANDS:
        if f"{stem}{suffix}" in layout.index:
            return f"{stem}{suffix}"
    raise KeyError(f"{stem}{_COMMANDS[0]}")


_COMMANDS = ("_N", "_N_m", "_rad", "_m", "_rad_s", "_m_s", "_V", "_A_m2", "")
"""Ends of the columns of a command."""
_UNITS = (("_N_m_s", "N m s"), ("_N_m", "N m"), ("_N_s", "N s"), ("_rad_s", "rad/s"), ("_m_s", "m/s"), ("_rad", "rad"))


def unit_of(name: str) -> str:
    """Unit that a name ends in; empty for a plain number."""
    for suffix, unit in (*_UNITS, ("_m", "m"), ("_N", "N"), ("_J", "J"), ("_s", "s")):
        if name.endswith(suffix):
            return unit
    return ""
