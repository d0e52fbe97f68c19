"""Impacts: restitution, contact geometry, several contacts at one instant, equality constraints, heat of friction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ffsm_mj.model.system import System
from ffsm_mj.records.kinds import kind_of
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.records.signals import FRICTION_HEAT, SLIDING_HEAT
from ffsm_mj.tolerances import MECHANISM_RANK
from ffsm_mj.verification.independent.cones import TangentPlanes
from ffsm_mj.verification.independent.finding import (
    CONTACT_GEOMETRY,
    EQUALITIES,
    HEAT_OF_FRICTION,
    RESTITUTION_USED,
    SEVERAL_CONTACTS,
    TOLERANCES,
    Array,
    Finding,
    Worst,
)
from ffsm_mj.verification.independent.kept_rows import MOST, SAME_TIME_S
from ffsm_mj.verification.independent.scene import LoggedRows, LoggedScene, forces_known
from ffsm_mj.verification.independent.shapes import Shapes, touching

_NO_SPEED_M_S = 1e-9
"""Contacts that separate slower than this are at rest whatever the rule says: the rounding of gap rates is 1e-12 m/s."""
_UNSURE = 0.02
"""Share of the pressing acceleration within which it is open, computed from distances, whether a contact comes to rest."""


def restitution_used(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst difference of the coefficients of restitution in the records of impacts from those that the scenario states."""
    worst, sides = Worst(RESTITUTION_USED), GeomSides(scene.system)
    for _, event in groupby(scene.log.impact_records, key=lambda record: record.event):
        records = list(event)
        for record in records:
            expected = _stated(scene, sides, record)
            if expected is None:
                continue
            used = float(record.restitution_used)
            away = max(abs(record.restitution - expected), min(abs(used - expected), abs(used)))
            if used == 0.0 < expected:
                away = away if _may_rest(scene, rows, records, record) else max(away, expected)
            elif away == 0.0 and used > 0.0 and _must_rest(scene, rows, records, record):
                away = used
            worst.add(f"impact {record.event + 1}", away, 0.0, record.time_s, "")
    return worst.findings


def _stated(scene: LoggedScene, sides: GeomSides, record: Any) -> float | None:
    """Coefficient of restitution that the scenario states for the contact or joint of a record; None if it names none."""
    if hasattr(record, "joint"):
        limits = scene.scenario.get("joint_limits") or {}
        named = {scene.system.limited(key)[0]: set_limits for key, set_limits in limits.items()}
        return float((named.get(record.joint) or {}).get("restitution", 0.0))
    contacts = scene.scenario.get("contacts") or {}
    default = float((contacts.get("default") or {}).get("restitution", 1.0))
    rules = contacts.get("rules")
    if rules is None:
        return default
    having = [rule for rule in rules if rule.get("name") == record.rule and sides.names(rule["between"], record.geoms)]
    if not having:
        # The record names a rule that does not have these geoms: no coefficient is right.
        return np.inf
    stated = having[-1].get("restitution")
    return default if stated is None else float(stated)


def _rest_rule(scene: LoggedScene) -> tuple[float, float]:
    """Flights shorter than the first, s, are omitted, and separations slower than the second, m/s."""
    config: Mapping[str, Any] = scene.scenario.get("impact") or {}
    interval_s = config.get("rest_interval_s")
    return float(scene.scenario["time_step_s"] if interval_s is None else interval_s), float(
        config.get("rest_speed_m_s") or 0.0
    )


def _may_rest(scene: LoggedScene, rows: LoggedRows, event: list[Any], record: Any) -> bool:
    """Whether a contact that came to rest did so by the rule, from what its record says of the flights that it omits.

    The first of these lasts 2 s / b and is s^2 / (2 b) high, where the contact separates at s and is pressed at b; together
    the flights last 1 / (1 - e) times the first.
    """
    interval_s, speed_m_s = _rest_rule(scene)
    at_limit = hasattr(record, "joint")
    gap = record.dropped_gap if at_limit else record.dropped_gap_m
    free_s = record.dropped_flights_s * (1.0 - record.restitution)
    if free_s <= 0.0 or gap <= 0.0:
        # It did not separate without the rule either. One contact alone separates by its restitution, in an impact with
        # friction as by the law; of several, each impulse may bring the others to rest, and with e = 1 there is no rule.
        alone = len(event) == 1 and not at_limit and record.mu == 0.0
        return bool(gap <= _NO_SPEED_M_S and not (alone and record.restitution * record.approach_speed_m_s > _NO_SPEED_M_S))
    speed = 4.0 * gap / free_s
    if speed <= _NO_SPEED_M_S:
        return True
    if free_s > interval_s * (1.0 + 1e-9) and speed > speed_m_s * (1.0 + 1e-9):
        return False
    pressing = _pressing(scene, rows, event, record)
    return pressing is None or speed < max(speed_m_s, 0.5 * interval_s * pressing.most) * (1.0 + 1e-9)


def _must_rest(scene: LoggedScene, rows: LoggedRows, event: list[Any], record: Any) -> bool:
    """Whether a contact that bounced would have come to rest by the rule; False where that is not known."""
    if record.restitution >= 1.0 or (pressing := _pressing(scene, rows, event, record)) is None or pressing.least <= 0.0:
        return False
    interval_s, speed_m_s = _rest_rule(scene)
    return bool(record.separation_speed_m_s < max(speed_m_s, 0.5 * interval_s * pressing.least) * (1.0 - 1e-9))


def _pressing(scene: LoggedScene, rows: LoggedRows, event: list[Any], record: Any) -> Pressing | None:
    """Bounds on the acceleration that presses a contact; None where it is not computed here.

    That of several contacts, of joint limits, with friction or with grasps depends on the forces at the others; distances of
    geoms that are not convex are those of several pieces.
    """
    if len(event) > 1 or hasattr(record, "joint") or record.mu > 0.0 or scene.grasps:
        return None
    if any(scene.model.geom(name).id in scene.system.pieces for name in record.geoms):
        return None
    return pressing(scene, rows, record, _UNSURE)


_TRAVEL_M = 1e-3
"""Length that the relative motion of both geoms covers between the distances of a second difference."""
_LONGEST_S = 0.02
"""Longest time between them."""
_LIFT_M = 1e-4
"""The geoms are moved apart by this along the normal: distances of geoms that overlap are less exact."""
_DISTANCE_M = 1e-9
"""What a distance may be wrong by: 1e-12 m for round geoms, a few 1e-10 m for ellipsoids and meshes."""

_SMOOTH = 0.2
"""Share by which second differences over a step and over half of it may differ: at most 1e-3 m is moved, and curvatures of
smooth surfaces of 1e-2 m and more change by a tenth."""


class Pressing(NamedTuple):
    """Bounds on the acceleration that presses a contact, m/s^2."""

    least: float
    most: float


def pressing(scene: LoggedScene, rows: LoggedRows, record: Any, unsure: float) -> Pressing | None:
    """Bounds on the acceleration that presses a single contact right after a plastic impact; None if it is not known.

    The rest rule compares it with the speed of separation. Here it is minus the second difference of MuJoCo's distance of
    both geoms along the motion that follows: q(t) = q + v t + a t^2 / 2, with the velocities v after the impact if it were
    plastic, and the accelerations a that all forces but those of contacts give there.

    Args:
        scene: Models of the log; no grasp is closed.
        rows: Rows of the log.
        record: Record of an impact of one contact without friction.
        unsure: Relative width of the bounds, beside the errors of distances.
    """
    model, data = scene.model, scene.data
    before = dict(rows.kept.before.kept).get(record.time_s, -1)
    efforts = rows.efforts_after(scene, before, record.time_s)
    if efforts is None or not forces_known(scene):
        return None
    scene.put(record.qpos, scene.rates(record.qvel_before), efforts, record.time_s)
    geoms = [int(model.geom(name).id) for name in record.geoms]
    normal, point = np.array(record.normal), np.array(record.point_m)
    ways = [scene.body_rows(int(model.geom_bodyid[geom]), point)[:3] for geom in geoms]
    along = normal @ (ways[1] - ways[0])
    answer = np.linalg.solve(scene.mass_matrix(), along)
    plastic = data.qvel - answer * (along @ data.qvel) / (along @ answer)
    scene.put(record.qpos, plastic, efforts, record.time_s)
    acceleration = np.linalg.solve(scene.mass_matrix(), scene.free_force())
    speed = max(float(np.linalg.norm(way @ plastic)) for way in ways) + float(np.abs(plastic).max(initial=0.0))
    step = min(_LONGEST_S, _TRAVEL_M / max(speed, 1e-12))
    place, *away = (
        _distance(scene, np.array(record.qpos), plastic * t + 0.5 * acceleration * t * t, geoms, normal)
        for t in (0.0, -step, step, -0.5 * step, 0.5 * step)
    )
    drop, nearer = -(away[0] - 2.0 * place + away[1]) / step**2, -4.0 * (away[2] - 2.0 * place + away[3]) / step**2
    error = unsure * abs(drop) + 16.0 * _DISTANCE_M / step**2
    # Where another vertex or edge is the nearest one on the way, the distance has a kink: second differences over a step and
    # over half of it differ, or what happens before and after is not alike, as it is to third order at rest.
    uneven = max(abs(away[1] - away[0]), 4.0 * abs(away[3] - away[2])) / step**2
    if max(abs(drop - nearer), uneven) > _SMOOTH * abs(drop) + 5.0 * error:
        return None
    limit, error = (4.0 * nearer - drop) / 3.0, error + abs(drop - nearer)
    return Pressing(limit - error, limit + error)


def _distance(scene: LoggedScene, qpos: Array, change: Array, geoms: list[int], normal: Array) -> float:
    """Distance of two geoms after a change of the coordinates, the second moved along the normal, m."""
    model, data = scene.model, scene.data
    mujoco.mj_integratePos(model, qpos, change, 1.0)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    if (cone := next((geom for geom in geoms if geom in scene.system.cones), None)) is not None:
        planes, inward = TangentPlanes(scene, cone), normal if cone == geoms[0] else -normal
        other = geoms[1] if cone == geoms[0] else geoms[0]
        return planes.least_distance(data, other, planes.angle_of_normal(data, inward), _LIFT_M)
    data.geom_xpos[geoms[1]] += _LIFT_M * normal
    return float(mujoco.mj_geomDistance(model, data, geoms[0], geoms[1], 10.0 * _LIFT_M + _TRAVEL_M, None))


class GeomSides:
    """Names of the sides of contact rules that stand for each geom."""

    def __init__(self, system: System) -> None:
        """Index the geoms of a system."""
        self._system, model = system, system.mj
        names = [model.geom(i).name for i in range(model.ngeom)]
        short = Counter(name.partition("/")[2] for name in names)
        self._geoms = {name: name for name in names}
        self._geoms |= {
            bare: name for name in names if short[bare := name.partition("/")[2]] == 1 and bare not in self._geoms
        }
        self._models = {part.name for part in system.models}

    def names(self, between: Sequence[str], geoms: Sequence[str]) -> bool:
        """Whether two sides name two geoms, in one order or the other."""
        first, second = between
        a, b = geoms
        return self._pair(first, second, a, b) or self._pair(first, second, b, a)

    def _pair(self, first: str, second: str, a: str, b: str) -> bool:
        one, other = (name.partition("/")[0] for name in (a, b))
        if "*" in (first, second) and one == other:
            return False
        if "self" in (first, second):
            return one == other and self._has(second if first == "self" else first, b if first == "self" else a)
        return self._has(first, a) and self._has(second, b)

    def _has(self, side: str, geom: str) -> bool:
        """Whether a side has a geom: all, a model, a subtree, a geom or a body, in this order."""
        if side == "*" or side in self._models:
            return side in ("*", geom.partition("/")[0])
        if not side.endswith("/*") and side in self._geoms:
            return bool(self._geoms[side] == geom)
        model = self._system.mj
        try:
            body = self._system.index("body", side.removesuffix("/*"))
        except LookupError:
            return False
        at = int(model.geom(geom).bodyid[0])
        while side.endswith("/*") and at not in (0, body):
            at = int(model.body_parentid[at])
        return at == body


_APART_M = (0.1, 0.07, 0.13, 0.05, 0.2, 0.09, 0.16)
"""Distances to which the geoms are moved apart: lengths over them are angles.

The nearest points are the same at each. Along directions in which two bodies hardly curve, as along two sides at a small
angle, those of MuJoCo scatter by up to a millimetre: the best of them counts.
"""


def contact_geometry(scene: LoggedScene) -> list[Finding]:
    """Worst difference of the normals and points of impacts from those of the geoms moved apart, rad, by MuJoCo's distances.

    Two convex bodies touch with the normal n if and only if the second, moved by d along n, is at a distance d, and the
    points that touched are the nearest ones: planes across n keep the two apart, at any d. Of geoms that are not convex, the
    pieces at the contact point are taken two by two.
    """
    worst = Worst(CONTACT_GEOMETRY)
    impacts = [record for record in scene.log.impact_records if not hasattr(record, "joint")]
    for record in impacts[:: 1 + len(impacts) // MOST]:
        worst.add(f"impact {record.event + 1}", _miss(scene, record), 0.0, record.time_s, "rad")
    return worst.findings


def _miss(scene: LoggedScene, record: Any) -> tuple[float, float]:
    """Angle of the normal to the line between the nearest points, and that of the contact point beside it."""
    first, second = (int(scene.model.geom(name).id) for name in record.geoms)
    scene.put(record.qpos, np.zeros(scene.model.nv))
    if scene.system.cones.keys() & {first, second}:
        return _miss_in_cone(scene, record, first, second)
    best = (np.inf, np.inf)
    # Of the pieces at a point those touch that the normal keeps apart; others meet beside them.
    for shapes in touching(scene, (first, second), np.array(record.point_m)):
        misses, place = [], shapes.data.geom_xpos[shapes.second].copy()
        for apart_m in _APART_M:
            shapes.data.geom_xpos[shapes.second] = place + apart_m * np.array(record.normal)
            misses.append(_miss_at(shapes, record, apart_m))
            if max(misses[-1]) <= TOLERANCES[CONTACT_GEOMETRY]:
                break
        between, beside = zip(*misses, strict=True)
        best = min(best, (min(between), min(beside)), key=max)
        if max(best) <= TOLERANCES[CONTACT_GEOMETRY]:
            break
    return best


def _miss_in_cone(scene: LoggedScene, record: Any, first: int, second: int) -> tuple[float, float]:
    """The same inside a cone: the normal is that of the tangent plane at the point, which the other geom touches."""
    cone, other, inward = (first, second, 1.0) if first in scene.system.cones else (second, first, -1.0)
    planes, point, nearest = TangentPlanes(scene, cone), np.array(record.point_m), np.empty(6)
    if planes.is_at_rim(scene.data, point):
        return 0.0, 0.0  # no tangent plane is there
    angle, apart_m = planes.angle_of(scene.data, point), _APART_M[0]
    normal = planes.normal(scene.data, angle)
    off = planes.distance(scene.data, other, angle, apart_m, nearest) - apart_m
    beside = (point - nearest[:3]) @ normal - apart_m
    between = np.linalg.norm(normal - inward * np.array(record.normal))
    return max(float(between), abs(off) / apart_m), abs(float(beside)) / apart_m


def _miss_at(shapes: Shapes, record: Any, apart_m: float) -> tuple[float, float]:
    """The same of two shapes at a distance in m."""
    normal, point, nearest = np.array(record.normal), np.array(record.point_m), np.empty(6)
    mujoco.mj_geomDistance(shapes.model, shapes.data, shapes.first, shapes.second, 2.0 * apart_m, nearest)
    between, beside = nearest[3:] - nearest[:3] - apart_m * normal, point - nearest[:3]
    # Of several points of a face the nearest one is any: all are in the plane across the normal.
    away = np.linalg.norm(beside) if record.manifold == "point" else abs(beside @ normal)
    return float(np.linalg.norm(between)) / apart_m, float(away) / apart_m


_LAWS = ("blend", "newton")
"""Laws of which this is a part; others share impulses in other ways."""


def several_contacts(scene: LoggedScene, rows: LoggedRows) -> list[Finding]:
    """Worst difference of the speeds after an impact of several contacts from (1 + e) times the plastic impulse.

    That is the law where all e are equal and no contact approaches after it, as where a face lands flat. Impacts with closed
    grasps, joint limits or friction are left out, and those in which contacts or limits that are closed already react.
    """
    worst = Worst(SEVERAL_CONTACTS)
    events = [list(event) for _, event in groupby(scene.log.impact_records, key=lambda record: record.event)]
    covered = [event for event in events if len(event) > 1 and all(_is_covered(record, event[0]) for record in event)]
    for event in covered[:: 1 + len(covered) // MOST] if not scene.grasps else ():
        if _is_alone(scene, rows, event[0].time_s):
            _compare(scene, event, worst)
    return worst.findings


def _is_alone(scene: LoggedScene, rows: LoggedRows, time_s: float) -> bool:
    """Whether no contact or limit was closed in the row before an impact, and no event has closed one since."""
    number = dict(rows.kept.before.kept).get(time_s, -1)
    if number not in rows.kept or not rows.is_whole:
        return False
    closed = np.any(scene.contact_states(rows.kept[number]))
    return not closed and not rows.has_events(rows.time_s(number) - SAME_TIME_S, time_s - SAME_TIME_S)


def _is_covered(record: Any, first: Any) -> bool:
    without_friction = not hasattr(record, "joint") and record.mu == 0.0 and record.law in _LAWS
    return without_friction and record.restitution_used == first.restitution_used


def _compare(scene: LoggedScene, records: list[Any], worst: Worst) -> None:
    from scipy.optimize import nnls  # takes a second to import: only impacts with several contacts pay

    scene.put(records[0].qpos, scene.rates(records[0].qvel_before))
    J = np.stack([_row(scene, record) for record in records])
    L = np.linalg.cholesky(scene.mass_matrix())
    A, w = np.linalg.solve(L, J.T).T, L.T @ scene.data.qvel
    lengths = np.linalg.norm(A, axis=1)
    if not np.all(lengths > 0.0):
        return
    plastic = A.T @ (nnls(A.T / lengths, -w)[0] / lengths)
    before, elastic = A @ w, A @ (w + 2.0 * plastic)
    if elastic.min() < -1e-9 * np.abs(before).max():
        return  # further reflections follow: the law decides on them
    after = A @ (w + (1.0 + records[0].restitution_used) * plastic)
    logged = np.array([record.separation_speed_m_s for record in records])
    worst.add(f"impact {records[0].event + 1}", logged - after, before, records[0].time_s, "m/s")


def _row(scene: LoggedScene, record: Any) -> Array:
    """Normal velocity of the second geom's body relative to the first's at the contact point, (nv,)."""
    first, second = (int(scene.model.geom(name).bodyid[0]) for name in record.geoms)
    point = np.array(record.point_m)
    relative = scene.body_rows(second, point)[:3] - scene.body_rows(first, point)[:3]
    return np.asarray(np.array(record.normal) @ relative)


def equalities(scene: LoggedScene) -> list[Finding]:
    """Worst change of the rates of equality constraints in an event of a log, by MuJoCo's own rows of them.

    An impulse leaves them closed. An impact that the rows of couplings and loops do not take part in tears them apart, and
    the projection of the step after it would close them again, at the expense of an energy that balances take as they find
    it.
    """
    worst = Worst(EQUALITIES)
    if not np.any(scene.model.eq_active0):
        return []
    logged = [record for record in scene.log.events if hasattr(record, "qvel_before") and hasattr(record, "qvel_after")]
    for _, event in groupby(logged, key=lambda record: (record.time_s, record.qvel_before, record.qvel_after)):
        record = next(event)  # of one event all have the same state
        before, after = scene.rates(record.qvel_before), scene.rates(record.qvel_after)
        scene.put(record.qpos, before)
        rows = _independent(scene.equality_rows(), scene.mass_matrix())
        # Those that the event stops, as the closing of a grasp does, had drifted before by what is no concern of it.
        change = np.minimum(np.abs(rows @ (after - before)), np.abs(rows @ after))
        worst.add(kind_of(record).name, change, np.abs(rows) @ (np.abs(before) + np.abs(after)), record.time_s, "m/s, rad/s")
    return worst.findings


def _independent(rows: Array, M: Array) -> Array:
    """Combinations of rows that motions change, (r, nv): others are numbers of a file that are rounded."""
    left, sizes, _ = np.linalg.svd(np.linalg.solve(np.linalg.cholesky(M), rows.T).T, full_matrices=False)
    return np.asarray(left[:, sizes > MECHANISM_RANK * sizes.max(initial=0.0)].T @ rows)


def friction_heat(log: RunLog, rows: LoggedRows) -> list[Finding]:
    """Worst residual of the heat of friction: of its sum, and where it falls."""
    layout, kept = rows.kept.layout, rows.kept
    column, worst = layout.index.get(f"balance.{FRICTION_HEAT}"), Worst(HEAT_OF_FRICTION)
    block = np.array([kept[number] for number in kept.spread.kept if number in kept])
    if column is None or not len(block) or not rows.is_whole:
        return []
    rules = [i for key, i in layout.index.items() if key.startswith("contact.") and key.endswith(SLIDING_HEAT)]
    impacts = [(float(event[0].time_s), _heat(event)) for event in _events(log)]
    instants, heats = np.array([time_s for time_s, _ in impacts]), np.array([heat for _, heat in impacts])
    times, heat = block[:, layout.time], block[:, column]
    # Whether the row at the time of an impact is of before or after it is open.
    earlier, later = (np.searchsorted(instants, times + shift) for shift in (-SAME_TIME_S, SAME_TIME_S))
    excess = heat - block[:, rules].sum(axis=1) - np.concatenate(([0.0], np.cumsum(heats)))[earlier]
    # A log may begin later than its run: relative to the first row.
    away = np.where(earlier == later, np.abs(excess - excess[0]), 0.0)
    # The split of the work of several contacts at one instant is a convention: their share of heat may be negative.
    level = heat - np.concatenate(([0.0], np.cumsum(np.minimum(heats, 0.0))))[later]
    fall = np.maximum.accumulate(level) - level
    for residual, what in ((away, "sum"), (fall, "fall")):
        at = int(np.argmax(np.where(np.isnan(residual), np.inf, residual)))
        worst.add(what, residual[at], heat, float(times[at]), "J")
    return worst.findings


def _events(log: RunLog) -> list[list[Any]]:
    """Records of each impact in which a contact has friction, in order of time."""
    events = [list(records) for _, records in groupby(log.impact_records, key=lambda record: record.event)]
    rough = [event for event in events if any(getattr(record, "mu", 0.0) > 0.0 for record in event)]
    return sorted(rough, key=lambda event: float(event[0].time_s))


def _heat(event: list[Any]) -> float:
    """Heat of friction of an impact, J: energy lost, less what the normal impulses take."""
    normal = sum(getattr(record, "normal_work_J", 0.0) or getattr(record, "work_J", 0.0) for record in event)
    return float(normal - event[0].energy_change_J)
