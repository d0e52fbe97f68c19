"""ffsm-mj: contact rules, persistent contact with friction and a grasp; balances and a log in memory are on."""

from __future__ import annotations

import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from engine_runs.mjcf import body_xml, motors
from engine_runs.scene import SETTLE_S, Scene, initial_twists
from engine_runs.states import States
from engine_runs.with_mujoco import Recipe, built, states
from ffsm_mj.assembly.prepare import PreparedRun, prepare
from ffsm_mj.assembly.run import simulate

FAR = 1e12
OFF = {"kind": "off"}


def _model(scene: Scene, root: str, site: str) -> str:
    body = body_xml(scene, scene.body(root), "", damping=False)
    body = body.replace("</body>", f"{site}</body>", 1) if site else body
    of_robot = root == scene.bodies[0].name
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>{body}</worldbody>'
        f"<actuator>{motors(scene) if of_robot else ''}</actuator></mujoco>"
    )


def _constant(efforts: dict[str, float]) -> dict[str, Any]:
    """A PD law whose target is so far away that its effort is constant to 1e-11."""
    signs = np.sign(list(efforts.values()))
    return {
        "kind": "pd",
        "joints": list(efforts),
        "kp": [abs(effort) / FAR for effort in efforts.values()],
        "kd": 0.0,
        "target": (signs * FAR).tolist(),
    }


def prepared(scene: Scene, step_s: float) -> PreparedRun:
    """The scene as a scenario."""
    robot, *others = [body.name for body in scene.bodies if body.joint is None or not body.joint.parent]
    files = {robot: "robot.xml"} | {name: f"{name}.xml" for name in others}
    data: dict[str, Any] = {
        "name": scene.name,
        "duration_s": scene.duration_s,
        "time_step_s": step_s,
        "control_period_s": step_s,
        "robot": {"mjcf": files[robot]},
        "objects": {name: {"mjcf": files[name]} for name in others},
        "initial": {"rates": _rates(scene, robot)},
        "contacts": {
            "rules": [
                {"between": [first, f"{second}/{second}"], "restitution": scene.restitution, "mu": scene.mu}
                for first, second in scene.touching
            ]
        },
        "phases": _phases(scene),
    }
    sites = _sites(scene)
    if scene.weld:
        when, handle = {"within": {"position_m": 1e-6}}, f"{scene.weld[1]}/handle"
        data["grasps"] = {"grasp": {"robot_site": "grip", "object_site": handle, "when": when}}
    with TemporaryDirectory() as folder:
        for name, file in files.items():
            (Path(folder) / file).write_text(_model(scene, name, sites.get(name, "")))
        path = Path(folder) / "scene.yaml"
        path.write_text(json.dumps(data))  # JSON is YAML
        return prepare(path)


def _rates(scene: Scene, robot: str) -> dict[str, Any]:
    """Velocities at the start, by joint."""
    rates: dict[str, Any] = {}
    for body, twist in zip(scene.bodies, initial_twists(scene).values(), strict=True):
        if body.joint is None:
            rates[f"{'robot' if body.name == robot else body.name}/{body.name}"] = np.concatenate(twist).tolist()
        elif body.joint.rate:
            rates[f"robot/{body.name}"] = body.joint.rate
    return rates


def _phases(scene: Scene) -> list[dict[str, Any]]:
    """Off; or efforts that begin at their times; or a grasp that closes at the start."""
    if scene.efforts:
        first = {name: effort for name, (effort, begin) in scene.efforts.items() if begin == 0.0}
        then = {name: effort for name, (effort, _) in scene.efforts.items()}
        return [
            {"name": "settle", "for_s": SETTLE_S, "controller": _constant(first)},
            {"name": "push", "until": "end", "controller": _constant(then)},
        ]
    last = {"name": "coast", "until": "end", "controller": OFF}
    return [{"name": "close", "until": "grasp", "arm": ["grasp"], "controller": OFF}, last] if scene.weld else [last]


def _sites(scene: Scene) -> dict[str, str]:
    """Of the grasp, by body."""
    if not scene.weld:
        return {}
    base, held = map(scene.body, scene.weld)
    x, y, z = np.array(held.position_m) - np.array(base.position_m)
    return {base.name: f'<site name="grip" pos="{x} {y} {z}"/>', held.name: '<site name="handle"/>'}


def run(scene: Scene, step_s: float) -> tuple[list[States], float]:
    """States at the scene's times and CPU time in s of the whole run without its set-up."""
    assembly = prepared(scene, step_s).assemble()
    clock = time.process_time()
    finished = simulate(assembly)
    spent = time.process_time() - clock
    if finished.outcome != "completed":
        raise RuntimeError(f"{finished.outcome}: {finished.summary()['message']}")
    model, data = built(scene, Recipe('integrator="RK4"'), step_s)
    columns = {
        letter: np.column_stack([finished[key] for key in finished.keys if key.startswith(f"state.{letter}_")])
        for letter in "qv"
    }
    found = []
    for time_s in scene.times_s:
        row = int(np.argmin(np.abs(finished.time - time_s)))
        data.qpos[:], data.qvel[:] = columns["q"][row], columns["v"][row]
        found.append(states(scene, model, data))
    return found, spent
