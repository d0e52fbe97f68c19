"""Forces of closed contacts found anew from a state and efforts alone: by other functions than those that made the motion.

Where the pairs touch and how their gaps accelerate comes from the support functions of their geoms
(:mod:`ffsm_mj.contact.second_rate`), not from frozen features; all closed pairs enter one inequality problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from ffsm_mj.arrays import FloatArray
from ffsm_mj.contact.pairs import ContactPair, Proximity
from ffsm_mj.contact.regimes import Scene
from ffsm_mj.impact.contact import Contact, contact_jacobian
from ffsm_mj.impact.laws import project
from ffsm_mj.lasting.closed import closed_and_still, held_stillness
from ffsm_mj.lasting.report import force_keys, mode_key
from ffsm_mj.model.dynamics import mass_matrix
from ffsm_mj.motion.flight import WHOLE_STATE
from ffsm_mj.records.signals import Layout

_NEAR_M = 1e-6


class ContactCheck:
    """Compares the contact forces of rows with those that the state of the row asks for."""

    def __init__(self, scene: Scene, pairs: Sequence[ContactPair], layout: Layout) -> None:
        """Bind to the data that is at the state of the row when asked."""
        self._scene, self._pairs = scene, tuple(pairs)
        self._forces = layout.places(key for pair in pairs for key in force_keys(pair))
        self._modes = layout.places(mode_key(pair) for pair in pairs)
        self._scratch = mujoco.MjData(scene.system.mj)

    def residual(self, row: FloatArray, rigid: frozenset[frozenset[int]]) -> float:
        """Largest difference of a pair's resultant force from that in a row, N; 0 where no pair is closed.

        Args:
            row: Of the log.
            rigid: Pairs of geoms that are on one rigid body there: they exert no contact forces.
        """
        logged = row[self._forces].reshape(-1, 3)
        told = row[self._modes] > 0.0
        touching = [
            (pair, near)
            for pair, lasts in zip(self._pairs, told, strict=True)
            if pair.geom_ids not in rigid and (near := self._closed(pair, lasts))
        ]
        if not touching and not np.any(logged):
            return 0.0
        found = dict.fromkeys(self._pairs, np.zeros(3)) | self._resultants(touching)
        return float(max(np.linalg.norm(force - found[pair]) for pair, force in zip(self._pairs, logged, strict=True)))

    def _closed(self, pair: ContactPair, lasts: bool) -> Proximity | None:
        model, data = self._scene.system.mj, self._scene.data
        if pair.gap(model, data, 1.0) > _NEAR_M:
            return None
        near = pair.proximity(model, data)
        return near if closed_and_still(near, held_stillness(near) if lasts else near.still) else None

    def _resultants(self, touching: Sequence[tuple[ContactPair, Proximity]]) -> dict[ContactPair, FloatArray]:
        """Force on the second geom of each pair, N."""
        # Of a face that is flat to 1e-6 rad all corners are near; those that open are in contact no more.
        points = [
            (pair, near, point)
            for pair, near in touching
            for point, rate in zip(near.points, near.rates.tolist(), strict=True)
            if abs(rate) <= held_stillness(near)
        ]
        if not points:
            return {}
        model, free = self._scene.system.mj, self._free_motion()
        contacts = [Contact(pair.body_a, pair.body_b, point, near.normal) for pair, near, point in points]
        J = np.stack([contact_jacobian(model, free, contact) for contact in contacts])
        rates = np.array([pair.second_rate(model, free, near, point).value for pair, near, point in points])
        A = np.linalg.solve(np.linalg.cholesky(mass_matrix(model, free)), J.T).T
        forces = project(A, np.linalg.lstsq(A, rates, rcond=None)[0])
        found: dict[ContactPair, Any] = {}
        for (pair, near, _), force in zip(points, forces.tolist(), strict=True):
            found[pair] = found.get(pair, np.zeros(3)) + force * near.normal
        return found

    def _free_motion(self) -> Any:
        """The state and efforts of the row, with the accelerations that there would be without contact forces."""
        model, data, scratch = self._scene.system.mj, self._scene.data, self._scratch
        state = np.empty(mujoco.mj_stateSize(model, WHOLE_STATE))
        mujoco.mj_getState(model, data, state, WHOLE_STATE)
        mujoco.mj_setState(model, scratch, state, WHOLE_STATE)
        scratch.qfrc_applied.fill(0.0)
        mujoco.mj_forward(model, scratch)
        return scratch
