"""Joints that move a site: those of an arm without its fingers, wheels and other arms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.controller_protocol import ConstrainedModel, ControllerContext, Fault, ScenarioFaults, driven_joints

_TRIALS = 4
_MOVES = 1e-9
"""Rate of a joint per rate of one that it follows, rad or m each, below which it is rounding."""


def joints_that_move(context: ControllerContext, site: str) -> tuple[str, ...]:
    """Names of the motor-driven joints that move a site relative to the base, without those of other parts of the phase.

    These are the joints between base and site, and those that other ones between them follow, by couplings or loops.

    Raises:
        ScenarioFaults: There is none.
    """
    system, model = context.system, context.system.mj
    driven = driven_joints(system, None, reserved=context.reserved)
    above = set(_bodies_above(model, int(model.site(site).bodyid[0])))
    moved = [dof for dof in range(model.nv) if int(model.dof_bodyid[dof]) in above]
    data = _configuration(model, 1)
    moves = np.any(np.abs(ConstrainedModel(model).follow(data, driven.dofs)[moved]) > _MOVES, axis=0)
    names = tuple(name for name, there in zip(driven.names, moves.tolist(), strict=True) if there)
    if not names:
        raise ScenarioFaults([Fault(f"no motor-driven joint that is left moves {site}; driven: {', '.join(driven.names)}")])
    return names


def controllable_directions(model: Any, site: int, dofs: Any, rows: Sequence[int]) -> int:
    """Number of directions in which some dofs can move a site: the greatest rank of its Jacobian in a few configurations.

    Args:
        model: MuJoCo model.
        site: Id of the site.
        dofs: The dofs.
        rows: Components of its motion that count: 0 to 2 of the position, 3 to 5 of the rotation, in world axes.
    """
    jacobian, constrained, rank = np.empty((6, model.nv)), ConstrainedModel(model), 0
    for k in range(1, _TRIALS + 1):
        data = _configuration(model, k)
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        reach = jacobian[list(rows)] @ constrained.follow(data, dofs)
        rank = max(rank, int(np.linalg.matrix_rank(reach, tol=1e-9)))
    return rank


def _configuration(model: Any, k: int) -> Any:
    """One of several configurations in which nothing is in line, positions current."""
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, np.sin(k * math.e * np.arange(1.0, model.nv + 1.0)), 1.0)
    mujoco.mj_fwdPosition(model, data)
    return data


def _bodies_above(model: Any, body: int) -> list[int]:
    """A body and all that it is mounted on, without the world."""
    bodies = []
    while body:
        bodies.append(body)
        body = int(model.body_parentid[body])
    return bodies
