"""What scenarios say of the laws on the task's output: what they share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, PositiveFloat

from ffsm_controllers.pd import Gain, Quaternion
from ffsm_mj.controller_protocol import Fault, ScenarioFaults, StrictModel, System, faults_below

_Name = Annotated[str, Field(min_length=1)]


class TaskLawConfig(StrictModel):
    """A law that brings the tip of the task to its target."""

    kind: str
    joints: tuple[_Name, ...] | None = None
    """Joints to drive; left out: the motor-driven joints that move the tip, so not fingers and wheels, without those of the
    base and of other parts."""


class AttitudeTarget(StrictModel):
    """Attitude that the tip is to have."""

    target: Quaternion | None = None
    """Quaternion w, x, y, z of the tip's frame in world axes; left out: that at the start of the phase."""


class PositionAccelerations(StrictModel):
    """Feedback of accelerations on the position of the tip."""

    kp_1_s2: Gain
    """Acceleration per distance, 1/s^2."""
    kd_1_s: Gain
    """Acceleration per velocity, 1/s; 2 sqrt(kp) damps critically."""


class AttitudeAccelerations(AttitudeTarget):
    """Feedback of angular accelerations on the attitude of the tip."""

    kp_1_s2: Gain
    """Angular acceleration per angle, 1/s^2."""
    kd_1_s: Gain
    """Angular acceleration per angular velocity, 1/s; 2 sqrt(kp) damps critically."""


class DampedConfig(TaskLawConfig):
    """A law that inverts the effective inertia of the tip, with damping near singularities."""

    joint_damping_N_m_s_rad: Gain = 0.0
    """Damping of motions of a redundant arm that the output does not feel, N m s/rad."""
    singular_mass_kg: PositiveFloat = 1000.0
    """Effective inertia of the tip, kg for pushes and kg m^2 for turns, above which a direction is near a singularity: its
    torques fade out, to nothing where the arm cannot move the tip that way at all."""


def object_site(system: System, name: str) -> int:
    """Id of a site that is of an object.

    Raises:
        ScenarioFaults: There is none of that name, or it is of the robot; path ``object_site``.
    """
    with faults_below("object_site"):
        full = system.resolve("site", name)
    if full.startswith("robot/"):
        sites = [candidate for candidate in system.names("site") if not candidate.startswith("robot/")]
        allowed = f"write one of {', '.join(sites)}" if sites else "add one to an object's model"
        raise ScenarioFaults([Fault(f"{full} is a site of the robot; {allowed}", ("object_site",))])
    return system.index("site", full)
