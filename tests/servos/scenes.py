"""A floating base and a balanced link: with a servo between them the link's angle obeys a scalar equation.

The base has 2 kg m^2 and the link 0.5 kg m^2 about the hinge: the reduced inertia is 0.4 kg m^2, and from rest of the whole
the base turns by -1/5 of the link's relative angle.
"""

from __future__ import annotations

import ffsm_mj
from tests.scenes import HEAD, scene

INERTIA = 0.4
KP, KV = 8.0, 0.6
SERVO = f'<position name="servo" joint="j" kp="{KP}" kv="{KV}"/>'
START = {"joints": {"j": 0.2}, "rates": {"j": -0.3, "free": [0, 0, 0, 0, 0, 0.06]}}


def link(actuators=SERVO, *, joint="", link_body=""):
    """MJCF of base and link."""
    return f"""<mujoco>{HEAD}<worldbody><body name="base"><freejoint name="free"/>
      <inertial pos="0 0 0" mass="5" diaginertia="2 2 2"/><geom name="hull" size="0.1" mass="0"/><site name="port"/>
      <body name="link"><joint name="j" axis="0 0 1" {joint}/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.5 0.5 0.5"/>
      <geom name="link" size="0.1" mass="0"/>{link_body}</body></body></worldbody>
      <actuator>{actuators}</actuator></mujoco>"""


def run_link(folder, controller, *, actuators=SERVO, model=None, **scenario):
    """A run of base and link under a control law from :data:`START`, by default 1 s in steps of 1 ms."""
    return ffsm_mj.run(link_scene(folder, controller, actuators=actuators, model=model, **scenario))


def link_scene(folder, controller, *, actuators=SERVO, model=None, others=None, **scenario):
    """Its scenario file; with models of other objects by name."""
    phases = [{"name": "all", "until": "end", "controller": controller}]
    return scene(folder, model or link(actuators), others or {}, **{"initial": START, "phases": phases} | scenario)


def playing(folder, setpoints):
    """A law that plays constant setpoints by their names or columns; one alone is that of the servo."""
    given = setpoints if isinstance(setpoints, dict) else {"robot/servo": setpoints}
    values = ",".join(map(str, given.values()))
    (folder / "setpoints.csv").write_text(f"time_s,{','.join(given)}\n0,{values}\n9,{values}\n")
    return {"kind": "playback", "file": "setpoints.csv"}


def steps(step_s):
    """Keys of a scenario with a time step and a control period."""
    return {"time_step_s": step_s, "control_period_s": step_s}
