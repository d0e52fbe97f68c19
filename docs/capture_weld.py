"""The table of ``docs/capture.md``: what is lost while an object is held, here, by forces in the stages, and by a weld."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

_STEP_S, _DURATION_S = 1e-3, 10.0
_TARGET = """<inertial pos="0.03 -0.02 0.01" mass="3" diaginertia="0.04 0.05 0.06"/>"""
_SCENE = """<mujoco><option gravity="0 0 0" integrator="RK4" timestep="0.001"><flag contact="disable"/></option>
<worldbody><body name="base"><freejoint/><inertial pos="0.02 0.01 0" mass="8" diaginertia="0.5 0.6 0.7"/>
<body pos="0.3 0 0"><joint axis="0 0 1"/><inertial pos="0.2 0 0" mass="1" diaginertia="0.01 0.02 0.03"/>
<body name="hand" pos="0.4 0 0"><joint axis="0 1 0"/><inertial pos="0.1 0 0" mass="0.7" diaginertia="0.01 0.012 0.013"/>
{held}</body></body></body>{free}</worldbody>{weld}</mujoco>"""
_PLACE = 'pos="0.27 0.02 0.03"'
_POINT = (0.27, 0.02, 0.03)
_FREE = {"held": "", "free": f'<body name="target"><freejoint/>{_TARGET}</body>', "weld": ""}
_CHILD = {"held": f"<body {_PLACE}>{_TARGET}</body>", "free": "", "weld": ""}


def _welded(how: str) -> dict[str, str]:
    weld = f'<equality><weld body1="hand" body2="target" relpose="0.27 0.02 0.03 1 0 0 0" {how}/></equality>'
    return _FREE | {"weld": weld}


def _hold(model: Any, data: Any) -> None:
    """In a stage of a step: the forces of six rows that leave the target no acceleration relative to the hand."""
    J, rate, point = np.zeros((6, model.nv)), np.zeros((6, model.nv)), data.body("target").xpos
    for name, sign in (("target", 1.0), ("hand", -1.0)):
        part, body = np.empty((6, model.nv)), model.body(name).id
        mujoco.mj_jac(model, data, part[:3], part[3:], point, body)
        J += sign * part
        mujoco.mj_jacDot(model, data, part[:3], part[3:], point, body)
        rate += sign * part
    smooth, response = np.empty((1, model.nv)), np.empty_like(J)
    mujoco.mj_solveM(model, data, smooth, -data.qfrc_bias[None])
    mujoco.mj_solveM(model, data, response, J)
    data.qfrc_applied[:] = J.T @ np.linalg.solve(response @ J.T, -(J @ smooth[0] + rate @ data.qvel))


def _kept(model: Any, data: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], float]:
    """P, L about the origin, and the kinetic energy."""
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    P, momentum = model.body_subtreemass[0] * data.subtree_linvel[0], np.empty(model.nv)
    mujoco.mj_mulM(model, data, momentum, data.qvel)
    return P, data.subtree_angmom[0] + np.cross(data.subtree_com[0], P), 0.5 * float(momentum @ data.qvel)


def _lost(words: dict[str, str], hold: Any = None) -> list[float]:
    model = mujoco.MjModel.from_xml_string(_SCENE.format(**words))
    data = mujoco.MjData(model)
    data.qvel[:8] = 0.3 * np.sin(np.arange(1.0, 9.0))
    mujoco.mj_forward(model, data)
    if model.nv > 8:  # the target with the velocities of a part of the hand
        hand, place = (
            model.body("hand").id,
            data.body("hand").xmat.reshape(3, 3) @ _POINT + data.body("hand").xpos,
        )
        linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jac(model, data, linear, angular, place, hand)
        data.qpos[9:12], data.qpos[12:16] = place, data.body("hand").xquat
        data.qvel[8:11], data.qvel[11:14] = (
            linear @ data.qvel,
            data.body("hand").xmat.reshape(3, 3).T @ (angular @ data.qvel),
        )
    before = _kept(model, data)
    mujoco.set_mjcb_control(hold)
    try:
        for _ in range(round(_DURATION_S / _STEP_S)):
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    after = _kept(model, data)
    return [float(np.linalg.norm(np.subtract(b, a))) for a, b in zip(before, after, strict=True)]


if __name__ == "__main__":
    for name, *how in (
        ("a child of the link", _CHILD),
        ("six rows in the stages", _FREE, _hold),
        ("weld, MuJoCo's default", _welded("")),
        ("weld, solref 2h, solimp 0.9999", _welded('solref="0.002 1" solimp="0.9999 0.9999 0.001"')),
    ):
        print(f"{name:32} " + "  ".join(f"{what} {lost:.0e}" for what, lost in zip("PLT", _lost(*how), strict=True)))
