"""Errors of a run against the exact solution of its scene."""

from __future__ import annotations

import numpy as np

from engine_runs import exact
from engine_runs.scene import LOAD_WINDOW_S, Scene
from engine_runs.states import States, rotation, totals


def reference(scene: Scene) -> list[States]:
    """Exact states at the scene's times; none for ``grip``."""
    if scene.name == "collision":
        return [exact.after_collision(scene.restitution)]
    return {"flight": exact.flown, "weld": exact.welded, "grip": list}[scene.name]()


def errors(scene: Scene, found: list[States]) -> dict[str, float]:
    """By name, in the units that the name ends with; ratios without."""
    if not all(np.isfinite(part).all() for states in found for part in vars(states).values()):
        return {}
    if scene.name == "grip":
        return _of_grip(found)
    truth = reference(scene)
    end, exact_end = found[-1], truth[-1]
    is_now, should = totals(scene, end), totals(scene, exact_end)
    values = {
        "position_m": float(np.linalg.norm(end.position - exact_end.position, axis=1).max()),
        "energy": is_now.T / should.T - 1.0,
        "P": float(np.linalg.norm(is_now.P - should.P) / np.linalg.norm(should.P)),
        "L": float(np.linalg.norm(is_now.L - should.L) / np.linalg.norm(should.L)),
    }
    if scene.name == "collision":
        mass = np.array([body.mass_kg for body in scene.bodies])
        inertia = np.array([body.inertia_kg_m2 for body in scene.bodies])
        off = mass @ ((end.velocity - exact_end.velocity) ** 2).sum(axis=1)
        off += (inertia * (end.rate - exact_end.rate) ** 2).sum()
        values |= {"velocity": float(np.sqrt(off)), "energy_ratio": is_now.T / 0.5}  # 1 kg at 1 m/s before
    if scene.name == "weld":
        values |= _of_weld(scene, found, truth)
    return values


def _of_weld(scene: Scene, found: list[States], truth: list[States]) -> dict[str, float]:
    """Drift of the object in the frame of the base, and its mean load over the last tenth of a second."""
    place = np.array(scene.bodies[1].position_m) - np.array(scene.bodies[0].position_m)
    base, held = rotation(found[-1].orientation)
    turned = base.T @ held
    loads = [
        scene.bodies[1].mass_kg * (states[-1].velocity[1] - states[-2].velocity[1]) / LOAD_WINDOW_S
        for states in (found, truth)
    ]
    return {
        "drift_m": float(np.linalg.norm(base.T @ (found[-1].position[1] - found[-1].position[0]) - place)),
        "drift_rad": float(
            np.linalg.norm([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
        ),
        "load": float(np.linalg.norm(loads[0] - loads[1]) / np.linalg.norm(loads[1])),
    }


def _of_grip(found: list[States]) -> dict[str, float]:
    """Slip of the box in the grip along the push, and what is missing of the momentum that was pushed in."""
    slips = [states.position[0, 0] - states.position[3, 0] for states in found]
    speeds, mass = found[-1].velocity[:, 0], np.array([10.0, 0.2, 0.2, 2.0])
    pushed = exact.pushed_speed() * mass.sum()
    return {
        "slip_rate_m_s": float(abs(slips[-1] - slips[-2])),
        "slip_m": float(abs(slips[-1] - slips[0])),
        "P": float(abs(mass @ speeds - pushed) / pushed),
    }
