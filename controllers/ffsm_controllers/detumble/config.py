"""What a scenario says of the law ``detumble``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, PositiveFloat, model_validator

from ffsm_controllers.base_control import Frame
from ffsm_mj.controller_protocol import StrictModel

Share = Annotated[float, Field(gt=0.0, le=1.0)]


class DetumbleArm(StrictModel):
    """What the arm does meanwhile: it is held where it is, or moves to given positions."""

    joints: tuple[str, ...] | None = None
    """Joints to drive; left out: every motor-driven joint of the robot but those of the base, the wheels and other parts."""
    bandwidth_rad_s: PositiveFloat = 1.0
    """Natural frequency of the feedback on the joints, critically damped, rad/s."""
    positions: tuple[float, ...] | None = None
    """Position of each joint to move to, rad or m; left out: those at the start of the phase."""
    over_s: PositiveFloat | None = None
    """Duration of the move, s, on the path of least jerk; needed with ``positions``."""
    null_space: bool = False
    """Move in the reaction null space only: by what does not turn the base. The positions may then not be reached."""

    @model_validator(mode="after")
    def _is_consistent(self) -> DetumbleArm:
        if (self.positions is None) != (self.over_s is None):
            raise ValueError("'positions' and 'over_s' go together: where to move, and in what time")
        if self.null_space and self.positions is None:
            raise ValueError("'null_space' needs 'positions' and 'over_s': where to move, and in what time")
        return self


class LatchLoad(StrictModel):
    """Greatest load of the closed grasp that the law causes."""

    share: Share | None = None
    """Share of the ``load_limit`` of the grasp."""
    force_N: PositiveFloat | None = None
    """Force of the link on the object, N."""
    torque_N_m: PositiveFloat | None = None
    """Torque on the object about the object's site, N m."""

    @model_validator(mode="before")
    @classmethod
    def _states_one(cls, data: Any) -> Any:
        if isinstance(data, dict) and not any(value is not None for value in data.values()):
            raise ValueError("needs one at least: share, force_N, torque_N_m")
        return data


class DetumbleConfig(StrictModel):
    """The angular momentum of robot and grasped object, except that of the wheels, is brought to zero."""

    kind: Literal["detumble"]
    frame: Frame = "world"
    """Axes in which the stack comes to rest: ``world``, or with an orbit ``lvlh``, with which it then turns."""
    wheels: tuple[str, ...] = ()
    """Motors of reaction wheels, which take the momentum first."""
    thrusters: tuple[str, ...] = ()
    """Actuators at sites or on the base that take what saturated wheels cannot, as couples where the layout has them."""
    rate_1_s: PositiveFloat = 0.5
    """Rate k at which the momentum L falls where no limit is reached: dL/dt = -k L, 1/s."""
    max_torque_N_m: PositiveFloat | None = None
    """Bound on |dL/dt| by the wheels, N m; left out: limits of actuators and grasp alone."""
    unload_to: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.8
    """Share of its maximum speed to which thrusters unload a wheel that has saturated."""
    latch: LatchLoad | None = None
    """Greatest load of the closed grasp; left out: half of its ``load_limit``, or none if it has none."""
    arm: DetumbleArm = DetumbleArm()
    """Left out: the arm is held where it is."""
    tolerance_N_m_s: PositiveFloat = 1e-6
    """``until: finished`` ends the phase when the momentum without the wheels is below this, and the arm has arrived."""
