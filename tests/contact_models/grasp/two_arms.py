"""A free-floating robot with two arms and a clamp on its base, and objects for them."""

from __future__ import annotations

from tests.contact_models.grasp.scenes import OFF
from tests.scenes import scene

_AXES = ("0 0 1", "0 1 0", "0 0 1", "1 0 0")


def _arm(side: str, y: float, axes, spring) -> str:
    """An arm of links along x; its last link has the hand and the site of the grasp."""
    text, sprung = "", f'stiffness="{spring[0]}" damping="{spring[1]}"' if spring else ""
    for k, axis in enumerate(axes):
        place = f"0.3 {y} 0" if k == 0 else "0.3 0 0"
        text += f"""<body name="{side}_{k}" pos="{place}"><joint name="{side}_{k}" type="hinge" axis="{axis}" {sprung}/>
          <inertial pos="0.15 0.01 0" mass="{1.2 - 0.2 * k}" diaginertia="0.01 0.02 0.025"/>"""
    text += f"""<geom name="{side}_hand" type="sphere" pos="0.2 0 0" size="0.05" mass="0"/>
      <site name="{side}" pos="0.25 0 0"/>"""
    return text + "</body>" * len(axes)


def robot(axes=_AXES, spring=None) -> str:
    """Base of 10 kg with two arms at y = 0.3 and -0.3, and a clamp between them.

    Args:
        axes: Axes of the joints of each arm.
        spring: Stiffness and damping of the joints; None: there are none.
    """
    motors = "".join(f'<motor name="{s}_{k}" joint="{s}_{k}"/>' for s in ("left", "right") for k in range(len(axes)))
    return f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0.02 0.01 0" mass="10" diaginertia="0.8 0.7 0.9"/>
      <geom name="hull" type="box" size="0.25 0.25 0.15" mass="0"/><site name="clamp" pos="0.6 0 0"/>
      {_arm("left", 0.3, axes, spring)}{_arm("right", -0.3, axes, spring)}
      </body></worldbody><actuator>{motors}</actuator></mujoco>"""


def plate(name: str = "plate") -> str:
    """An object of 3 kg with handles at both sides, and one that faces the clamp."""
    return f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="{name}"><freejoint name="free"/>
      <inertial pos="0.03 0.02 0" mass="3" diaginertia="0.05 0.08 0.06"/>
      <geom name="{name}" type="box" size="0.1 0.25 0.05" mass="0"/>
      <site name="to_left" pos="-0.1 0.2 0"/><site name="to_right" pos="-0.1 -0.2 0"/><site name="to_clamp" pos="-0.1 0 0"/>
      </body></worldbody></mujoco>"""


ANY = {"within": {"position_m": 5.0}}
LEFT = {"robot_site": "left", "object_site": "plate/to_left", "when": ANY}
RIGHT = {"robot_site": "right", "object_site": "plate/to_right", "when": ANY}
CLAMP = {"robot_site": "clamp", "object_site": "plate/to_clamp", "when": ANY}
JOINTS = {
    **dict(zip((f"left_{k}" for k in range(4)), (-0.5, 0.2, 0.7, 0.1), strict=True)),
    **dict(zip((f"right_{k}" for k in range(4)), (0.4, -0.3, -0.6, 0.2), strict=True)),
}
RATES = {
    **dict(zip((f"left_{k}" for k in range(4)), (0.1, -0.2, 0.15, 0.3), strict=True)),
    **dict(zip((f"right_{k}" for k in range(4)), (-0.1, 0.25, 0.1, -0.2), strict=True)),
    "robot/free": [0.02, -0.01, 0.03, 0.05, -0.04, 0.06],
    "plate/free": [-0.05, 0.1, 0.02, 0.2, -0.1, 0.15],
}
POSE = [1.6, 0.03, -0.02, 0.998, 0.03, 0.02, 0.05]
PD = {
    "kind": "pd",
    "kp": 1.0,
    "kd": 0.6,
    "target": [*JOINTS.values()],
}


def holding(folder, grasps=None, phases=None, objects=None, axes=_AXES, spring=None, **changes):
    """Both arms hold a plate from the first instant on; the left one lets go after half a second."""
    folder.mkdir(exist_ok=True)
    given = grasps or {"left": LEFT, "right": RIGHT}
    return scene(
        folder,
        robot(axes, spring),
        {"plate": plate(), **(objects or {})},
        **{
            "duration_s": 0.8,
            "time_step_s": 2e-3,
            "control_period_s": 1e-2,
            "initial": {"joints": {"plate/free": POSE, **JOINTS}, "rates": RATES},
            "grasps": given,
            "phases": phases
            or [
                {"name": "hold", "for_s": 0.5, "arm": [*given], "controller": PD},
                {"name": "leave", "until": "end", "release": [next(iter(given))], "controller": OFF},
            ],
        }
        | changes,
    )
