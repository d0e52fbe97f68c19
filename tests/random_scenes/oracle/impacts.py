"""Oracle of impulses: the velocity jump of every event from the logged impulses, and laws of single contacts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from tests.random_scenes.oracle.bodies import Array, State
from tests.random_scenes.oracle.scene import LoggedScene
from tests.random_scenes.oracle.shapes import UNKNOWN, gap_along

ROUNDING = 1e-10
"""Share of the terms of a sum to which it is known: some 1e3 roundings of 1e-16, times a condition of 1e3 of a light link
on a heavy base."""


def impact_differences(scene: LoggedScene) -> Iterator[str]:
    """What is wrong with impacts, grasps and releases."""
    for hits in scene.hits:
        state = scene.before(hits[0])
        yield from _jump(scene, state, hits)
        for hit in hits:
            yield from _speeds(scene, state, hit)
        if len(hits) == 1 and not scene.grasps_change(hits[0].time_s):
            yield from _law(scene, state, hits[0])
    for record in scene.run.records.get("grasp_impulses", ()):
        yield from _capture(scene, scene.before(record), record)


def contact_rows(scene: LoggedScene, state: State, hit: Any) -> Array:
    """(3, nv) Relative velocity of b against a at the point of an impact, in world axes."""
    a, b = (scene.bodies.geoms[name].body for name in hit.geoms)
    point = np.array(hit.point_m)
    return state.jacobian(b, point)[0] - state.jacobian(a, point)[0]


def limit_row(scene: LoggedScene, hit: Any) -> Array:
    row = np.zeros(scene.bodies.nv)
    row[scene.bodies.joints[hit.joint].v] = 1.0 if hit.side == "lower" else -1.0
    return row


def latches(scene: LoggedScene, state: State, names: list[str]) -> Array:
    """(n, nv) Rows of closed grasps."""
    return np.vstack([np.zeros((0, scene.bodies.nv)), *(scene.latch_rows(state, name) for name in names)])


def _jump(scene: LoggedScene, state: State, hits: list[Any]) -> Iterator[str]:
    """M dv = J^T impulses, up to impulses of closed latches, and v+ moves no latch."""
    M = state.mass_matrix()
    after = scene.bodies.rates(hits[0].qvel_after)
    given, size = np.zeros(scene.bodies.nv), 0.0
    for hit in hits:
        if hasattr(hit, "joint"):
            push = limit_row(scene, hit) * hit.impulse
        else:
            push = contact_rows(scene, state, hit).T @ _impulse(hit)
        given, size = given + push, size + float(np.linalg.norm(push))
    names = scene.closed(hits[0].time_s)
    # A grasp that closes at this time did so before the impact if nothing moves it any more.
    closing = [r.grasp for r in scene.run.records.get("grasp_impulses", ()) if r.time_s == hits[0].time_s]
    names += [each for each in closing if np.abs(scene.latch_rows(state, each) @ state.v).max() < 1e-9 * (1.0 + size)]
    rows = latches(scene, state, names)
    rest, scale = M @ (after - state.v) - given, size + float(np.linalg.norm(M @ state.v))
    yield from _beyond(f"impact: M dv less impulses, {_kind(hits)}", _across(rows, rest), ROUNDING * (1.0 + scale))
    yield from _beyond("impact: velocity of a closed latch", rows @ after, 1e-8 * (1.0 + np.linalg.norm(after)))
    for when, v in (("before", state.v), ("after", after)):
        mine = State(scene.bodies, state.q, v)
        energies = {name: mine.kinetic(name) for name in scene.models}
        logged = getattr(hits[0], f"energy_{when}_J")
        total = sum(energies.values())
        own = {"total": total, "robot": energies["robot"], "objects": total - energies["robot"]}
        for part, value in own.items():
            yield from _beyond(f"impact: energy {when} of {part}", value - logged[part][0], ROUNDING * (1.0 + total))
        momentum = sum(mine.momentum(name) for name in scene.models)
        off = momentum - np.array(getattr(hits[0], f"momentum_{when}")["total"])
        yield from _beyond(f"impact: momentum {when}", off, ROUNDING * (1.0 + scale) * 10.0)


def _speeds(scene: LoggedScene, state: State, hit: Any) -> Iterator[str]:
    """Speeds, gap, normal and restitution of a record."""
    after = scene.bodies.rates(hit.qvel_after)
    scale = 1.0 + float(np.linalg.norm(state.v) + np.linalg.norm(after))
    if hasattr(hit, "joint"):
        row = limit_row(scene, hit)
        speeds = (("rate", -hit.approach_rate, hit.separation_rate),)
    else:
        rows, normal = contact_rows(scene, state, hit), np.array(hit.normal)
        row = normal @ rows
        speeds = (("speed", -hit.approach_speed_m_s, hit.separation_speed_m_s),)
        yield from _geometry(scene, state, hit, normal)
        along = np.eye(3) - np.outer(normal, normal)
        if hit.mu > 0.0:
            for when, v in (("before", state.v), ("after", after)):
                slip = np.array(getattr(hit, f"slip_{when}_m_s"))
                yield from _beyond(f"impact: slip {when}", along @ rows @ v - slip, ROUNDING * scale)
            push = np.array(hit.tangential_impulse_N_s)
            over = np.linalg.norm(push) - hit.mu * hit.impulse_N_s
            yield from _beyond("impact: friction beyond its limit", max(over, 0.0), 1e-9 * (1.0 + hit.impulse_N_s))
    for what, before, behind in speeds:
        yield from _beyond(f"impact: {what} before", row @ state.v - before, ROUNDING * scale)
        yield from _beyond(f"impact: {what} after", row @ after - behind, ROUNDING * scale)
    # No contact of the event still approaches; a law of several contacts solves this to 1e-9.
    yield from _beyond("impact: approaches afterwards", min(row @ after, 0.0), 1e-9 * scale)
    if hit.restitution_used not in (0.0, hit.restitution):
        yield f"impact: restitution_used {hit.restitution_used} of {hit.restitution}"


def _geometry(scene: LoggedScene, state: State, hit: Any, normal: Array) -> Iterator[str]:
    """The gap across the normal by our support functions; that of flat meshes is known to single precision."""
    a, b = (scene.shape(state, name) for name in hit.geoms)
    if a.kind in UNKNOWN or b.kind in UNKNOWN:
        return
    level = max(scene.rounding(a), scene.rounding(b)) + 2e-9
    yield from _beyond(f"impact: gap of {'-'.join(sorted((a.kind, b.kind)))}", gap_along(a, b, normal) - hit.gap_m, level)


def _law(scene: LoggedScene, state: State, hit: Any) -> Iterator[str]:
    """One contact alone: its impulse and its velocity from the law, with the mechanism's own inverse mass."""
    if hit.status != "ok":
        return
    M = state.mass_matrix()
    rows = latches(scene, state, scene.closed(hit.time_s))
    normal_row = limit_row(scene, hit) if hasattr(hit, "joint") else np.array(hit.normal) @ contact_rows(scene, state, hit)
    e, speed = hit.restitution_used, float(normal_row @ state.v)
    impulse = hit.impulse if hasattr(hit, "joint") else hit.impulse_N_s
    if getattr(hit, "mu", 0.0) > 0.0:
        yield from _friction_law(scene, state, hit, M, rows)
        return
    inverse = float(normal_row @ _admissible(M, rows, normal_row[:, None])[:, 0])
    least = float(normal_row @ np.linalg.solve(M, normal_row))
    if inverse < 1e-6 * least:
        return  # all but stopped by latches
    mine = -(1.0 + e) * speed / inverse
    allowed = 1e-9 * least / inverse * (abs(mine) + (1.0 + np.linalg.norm(state.v)) / least)
    yield from _beyond("impact: impulse of one contact", mine - impulse, allowed)


def _friction_law(scene: LoggedScene, state: State, hit: Any, M: Array, rows: Array) -> Iterator[str]:
    """Stronge's law of one contact with Coulomb friction: the velocity over the normal impulse, and the work along it."""
    normal = np.array(hit.normal)
    axes = np.vstack([normal, np.linalg.svd(normal[None])[2][1:]])
    J = axes @ contact_rows(scene, state, hit)
    inverse = J @ _admissible(M, rows, J.T)
    if np.linalg.eigvalsh(inverse)[0] < 1e-6 * np.trace(inverse):
        return  # latches leave less than three motions: slip and approach are not independent
    start = J @ state.v
    if start[0] > -1e-9 or np.linalg.norm(start[1:]) < 1e-7 * (1.0 + np.linalg.norm(state.v)):
        return  # the direction of a slip that small is not known
    end = _path(inverse, start, hit.mu, hit.restitution_used)
    if end is None:
        return
    velocity, impulse = end
    logged = np.array([hit.impulse_N_s, *(axes[1:] @ np.array(hit.tangential_impulse_N_s))])
    scale = np.linalg.norm(start) + np.linalg.norm(state.v)
    yield from _beyond(
        "impact: velocity of one contact with friction",
        velocity - J @ scene.bodies.rates(hit.qvel_after),
        1e-7 * (1.0 + scale),
    )
    yield from _beyond(
        "impact: impulse of one contact with friction", impulse - logged, 1e-7 * (1.0 + np.linalg.norm(logged))
    )


def _path(B: Array, u: Array, mu: float, e: float) -> tuple[Array, Array] | None:
    """Velocity and impulse (normal, two tangential) at the end; None where the slip stops in a way that is not smooth."""

    def slides(_: float, y: Array) -> Array:
        slip = y[1:3]
        push = np.array([1.0, *(-mu * slip / np.linalg.norm(slip))])
        return np.array([*(B @ push), *push, y[0]])

    def stops(_: float, y: Array) -> float:
        return float(np.linalg.norm(y[1:3])) - 1e-9 * slip0

    def compressed(_: float, y: Array) -> float:
        return float(y[0])

    slip0, y, lowest = float(np.linalg.norm(u[1:])), np.array([*u, 0.0, 0.0, 0.0, 0.0]), None
    stops.terminal = True  # type: ignore[attr-defined]
    reach = 20.0 * np.abs(u).max() / B[0, 0]

    def finishes(_: float, y: Array) -> float:
        return float(y[6] - (1.0 - e * e) * lowest) if lowest is not None else -1.0

    sticking = False
    for _ in range(6):
        goal = compressed if lowest is None else finishes
        goal.terminal, goal.direction = True, 1.0  # type: ignore[attr-defined]
        if lowest is not None and (e == 0.0 or y[6] >= (1.0 - e * e) * lowest):
            return y[:3], y[3:6]
        if sticking:
            push = np.array([1.0, *(-np.linalg.solve(B[1:, 1:], B[1:, 0]))])
            if np.linalg.norm(push[1:]) > mu:
                return None  # slip reverses
            gain = float(B[0] @ push)
            if gain <= 0.0:
                return None
            if lowest is None:
                p = -y[0] / gain
            else:
                left = (1.0 - e * e) * lowest - y[6]
                p = (-y[0] + np.sqrt(y[0] ** 2 + 2.0 * gain * left)) / gain
            work = y[0] * p + 0.5 * gain * p * p
            y = np.array([y[0] + gain * p, 0.0, 0.0, *(y[3:6] + p * push), y[6] + work])
        else:
            found = solve_ivp(
                slides, (0.0, reach), y, "DOP853", events=(stops, goal), rtol=1e-12, atol=1e-14 * (1.0 + reach)
            )
            if found.status != 1:
                return None
            y = found.y[:, -1]
            if found.t_events[0].size:
                sticking = True
                continue
        if lowest is None:
            lowest = y[6]
        else:
            return y[:3], y[3:6]
    return None


def _capture(scene: LoggedScene, state: State, record: Any) -> Iterator[str]:
    """The latch stops its components; impulses act on the rows of closed grasps alone, with no momentum of their own."""
    M, after = state.mass_matrix(), scene.bodies.rates(record.qvel_after)
    same = [r.grasp for r in scene.run.records["grasp_impulses"] if r.time_s == record.time_s and r.event <= record.event]
    names = [name for name in scene.closed(record.time_s) if name != record.replaces]
    rows = latches(scene, state, list(dict.fromkeys([*names, *same])))
    scale = float(np.linalg.norm(M @ state.v))
    yield from _beyond("capture: M dv beyond the latches", _across(rows, M @ (after - state.v)), ROUNDING * (1.0 + scale))
    stopped = scene.latch_rows(state, record.grasp) @ after
    yield from _beyond("capture: velocity of the latch", stopped, 1e-8 * (1.0 + np.linalg.norm(after)))
    lost = sum(
        State(scene.bodies, state.q, v).kinetic(name) * sign
        for name in scene.models
        for v, sign in ((state.v, 1), (after, -1))
    )
    yield from _beyond("capture: loss of energy", lost - record.loss_J, ROUNDING * (1.0 + scale))
    if not names and len(same) == 1:
        given = scene.latch_rows_at_site(state, record).T @ np.array([*record.impulse_N_s, *record.angular_impulse_N_m_s])
        yield from _beyond("capture: M dv less the impulse", M @ (after - state.v) - given, ROUNDING * (1.0 + scale))


def _impulse(hit: Any) -> Array:
    return hit.impulse_N_s * np.array(hit.normal) + np.array(hit.tangential_impulse_N_s)


def _admissible(M: Array, rows: Array, forces: Array) -> Array:
    """M^-1 times generalised impulses, with latches closed."""
    free = np.linalg.solve(M, forces)
    if not len(rows):
        return free
    spread = np.linalg.solve(M, rows.T)
    return free - spread @ (np.linalg.pinv(rows @ spread, rcond=1e-11, hermitian=True) @ (rows @ free))


def _across(rows: Array, rest: Array) -> Array:
    """What of a generalised impulse no combination of rows gives."""
    if not len(rows):
        return rest
    return rest - rows.T @ np.linalg.lstsq(rows.T, rest, rcond=1e-12)[0]


def _kind(hits: list[Any]) -> str:
    return "one contact" if len(hits) == 1 else "several contacts"


def _beyond(what: str, off: Any, allowed: float) -> Iterator[str]:
    size = float(np.abs(off).max(initial=0.0)) if np.size(off) else 0.0
    if not size <= allowed:
        yield f"{what} ({size:.1e} of {allowed:.1e})"
