"""A scene for each contact model."""

from __future__ import annotations

from tests.scenes import ball, scene

ARM = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><freejoint name="free"/>
  <inertial pos="0 0 0" mass="8" diaginertia="0.5 0.6 0.7"/>
  <body name="link" pos="0.3 0 0"><joint name="elbow" type="hinge" axis="0 0 1"/>
  <inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.02 0.03"/><geom name="hand" type="sphere" pos="0.4 0 0" size="0.05"
  mass="0"/></body></body></worldbody><actuator><motor name="elbow" joint="elbow"/></actuator></mujoco>"""


def spring(folder, stiffness=100.0, step=1e-3, others=None, **changes):
    """A ball of 2 kg runs onto one of 3 kg, off centre, and is pushed back by a spring; with other objects, if any."""
    folder.mkdir(exist_ok=True)
    return scene(
        folder,
        ball("ball", mass=2.0),
        {"target": ball("target", mass=3.0), **(others or {})},
        **{
            "duration_s": 0.8,
            "time_step_s": step,
            "control_period_s": 4e-3,
            "initial": {
                "joints": {"target/free": [0.3, 0.02, 0.01, 1, 0, 0, 0]},
                "rates": {"robot/free": [0.5, 0.0, 0.0, 0.0, 0.0, 3.0]},
            },
            "contacts": {"rules": []},
            "contact_models": [{"kind": "spring", "geoms": ["ball", "target/target"], "stiffness_N_m": stiffness}],
        }
        | changes,
    )


def capture(folder, others=None, **changes):
    """A tumbling ball drifts into the hand of a free-floating arm, which grips it; with other objects, if any."""
    folder.mkdir(exist_ok=True)
    return scene(
        folder,
        ARM,
        {"target": ball("target", mass=3.0), **(others or {})},
        **{
            "duration_s": 2.0,
            "initial": {
                "joints": {"target/free": [1.0, 0.03, 0.02, 1, 0, 0, 0]},
                "rates": {"robot/free": [0, 0, 0, 0.02, -0.03, 0.05], "target/free": [-0.3, 0, 0, 0.4, -0.2, 0.3]},
            },
            "contacts": {"rules": []},
            "contact_models": [{"kind": "weld", "geoms": ["hand", "target/target"], "armed": True}],
            "phases": [
                {"name": "wait", "until": "weld", "controller": {"kind": "off"}},
                {"name": "hold", "until": "end", "controller": {"kind": "off"}},
            ],
        }
        | changes,
    )
