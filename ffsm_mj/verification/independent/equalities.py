"""Equality constraints at events: an impulse leaves them closed.

An impact that the rows of couplings and loops do not take part in tears them apart, and the projection of the step after it
would close them again, at the expense of an energy that balances take as they find it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ffsm_mj.tolerances import MECHANISM_RANK
from ffsm_mj.verification.independent.finding import Array, Finding, Worst
from ffsm_mj.verification.independent.scene import LoggedScene
from ffsm_mj.verification.independent.tolerances import EQUALITIES


def equalities(scene: LoggedScene) -> list[Finding]:
    """Worst change of the rates of equality constraints in an event of a log, by MuJoCo's own rows of them."""
    worst, events = Worst(EQUALITIES), dict[int, Any]()
    if not np.any(scene.model.eq_active0):
        return []
    logged: list[Any] = scene.log.events()
    for record in logged:
        if hasattr(record, "qvel_before") and hasattr(record, "qvel_after"):
            events[record.event] = record  # of one event all have the same state
    for number, record in events.items():
        before, after = scene.rates(record.qvel_before), scene.rates(record.qvel_after)
        scene.put(record.qpos, before)
        rows = _independent(scene.equality_rows(), scene.mass_matrix())
        # Those that the event stops, as the closing of a grasp does, had drifted before by what is no concern of it.
        change = np.minimum(np.abs(rows @ (after - before)), np.abs(rows @ after))
        worst.add(
            f"event {number + 1}", change, np.abs(rows) @ (np.abs(before) + np.abs(after)), record.time_s, "m/s, rad/s"
        )
    return worst.found


def _independent(rows: Array, M: Array) -> Array:
    """Combinations of rows that motions change, (r, nv): others are numbers of a file that are rounded."""
    left, sizes, _ = np.linalg.svd(np.linalg.solve(np.linalg.cholesky(M), rows.T).T, full_matrices=False)
    return np.asarray(left[:, sizes > MECHANISM_RANK * sizes.max(initial=0.0)].T @ rows)
