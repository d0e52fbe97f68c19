"""What the paper states of its case study (Table 1, 4.1 and 4.4), beside what the compiled models and the scenarios hold."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.validation.cases.seed_paper.measure import tip_state


def stated_inputs() -> list[tuple[str, str, str]]:
    """Name, printed text and our value of each input."""
    baseline, flying = prepare("baseline").assemble(), prepare("free-flying").assemble()
    return [*_bodies(baseline), *_start(baseline), *_control(baseline), *_free_flying(flying)]


def _numbers(values: Iterable[Any]) -> str:
    return ", ".join(f"{float(value):.5g}" for value in values)


def _bodies(assembly: Assembly) -> list[tuple[str, str, str]]:
    model = assembly.system.mj
    links = [model.body(f"robot/link_{i}") for i in (1, 2, 3)]
    base, box, payload = model.body("robot/base"), model.body("object/box"), model.body("robot/payload")
    lengths = [model.body(name).pos[0] for name in ("robot/link_2", "robot/link_3", "robot/payload")]
    side = 2.0 * model.geom("object/box").size[:2]
    return [
        ("mass of links, kg", "2, 2, 2", _numbers(link.mass[0] for link in links)),
        ("length of links, m", "2, 2, 2", _numbers(lengths)),
        ("centre of mass of links, m", "1, 1, 1", _numbers(link.ipos[0] for link in links)),
        ("inertia of links, kg m^2", "0.6667, 0.6667, 0.6667", _numbers(link.inertia[2] for link in links)),
        ("mass of load, kg", "1", _numbers(payload.mass)),
        ("mass of base, kg", "5", _numbers(base.mass)),
        ("inertia of base, kg m^2", "2.0833", _numbers([base.inertia[2]])),
        ("mass of object, kg", "5", _numbers(box.mass)),
        ("inertia of object, kg m^2", "0.8333", _numbers([box.inertia[2]])),
        ("side of object, m", "1, 1", _numbers(side)),
    ]


def _start(assembly: Assembly) -> list[tuple[str, str, str]]:
    tip, _ = tip_state(assembly.system, assembly.data)
    qpos = assembly.data.qpos
    return [
        ("object at the start: x, y, yaw, m, rad", "3.5, -0.5, 0", _numbers(qpos[6:9])),
        ("base at the start: x, y, yaw, m, rad", "5, -1.75, 0.1", _numbers(qpos[:3])),
        ("tip at the start, m", "7.5, 1.5", _numbers(np.round(tip[:2], 8))),
        ("angle of the third link, rad", "0.1", _numbers([qpos[2:6].sum()])),
    ]


def _control(assembly: Assembly) -> list[tuple[str, str, str]]:
    scenario, task = assembly.scenario, assembly.scenario.task
    approach, pause, regulate = scenario.phases
    motors = [scenario.actuators[f"motor_{i}"] for i in (1, 2, 3)]
    return [
        ("target of the tip, m", "3, 0", _numbers(task.target_m if task else ())),
        ("t_f, s", "30", _numbers([scenario.duration_s])),
        ("Q", "diag(1, 1, 0.5, 0.5)", f"diag({_numbers(approach.controller.Q)})"),
        ("R before the impact", "I", f"diag({_numbers(approach.controller.R)})"),
        ("R after the pause", "0.1 I", f"diag({_numbers(regulate.controller.R)})"),
        ("safety pause, s", "2.3", _numbers([pause.for_s])),
        ("stall torque of motors, N m", "14, 14, 14", _numbers(getattr(m, "stall_torque_N_m", np.nan) for m in motors)),
        ("no-load speed, rad/s", "0.54, 0.54, 0.54", _numbers(getattr(m, "no_load_speed_rad_s", np.nan) for m in motors)),
    ]


def _free_flying(assembly: Assembly) -> list[tuple[str, str, str]]:
    actuators, pause = assembly.scenario.actuators, assembly.scenario.phases[1]
    gains, thruster, wheel = pause.controller, actuators["thruster_x"].model_dump(), actuators["wheel"].model_dump()
    return [
        ("4.4: safety pause, s", "4.6", _numbers([pause.for_s])),
        ("4.4: K_p,t, K_d,t", "50, 0.75 K_p", _numbers([gains.translation.kp, gains.translation.kd])),
        ("4.4: K_p,r, K_d,r", "200, 0.75 K_p", _numbers([gains.rotation.kp, gains.rotation.kd])),
        ("4.4: K_p,a, K_d,a", "150, 0.75 K_p", _numbers([gains.arm.kp, gains.arm.kd])),
        ("4.4: thrust, threshold, N", "50, 1", _numbers([thruster["force_N"], thruster["threshold_N"]])),
        (
            "4.4: wheel's stall torque, N m, no-load speed, rad/s",
            "20, 2",
            _numbers([wheel["stall_torque_N_m"], wheel["no_load_speed_rad_s"]]),
        ),
    ]
