"""Oracle of rows: energies and momenta of the states, Newton's second law between rows, gaps, and sensors of motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.random_scenes.oracle.bodies import WIDTHS, Array, State
from tests.random_scenes.oracle.impacts import ROUNDING, _beyond, latches
from tests.random_scenes.oracle.scene import LoggedScene
from tests.random_scenes.oracle.shapes import UNKNOWN, distance_bounds

ROWS = 10
"""Rows of which sums are compared."""
GAP_ROWS = 3
"""Rows of which gaps are."""
INTERVALS = 2
"""Intervals between rows whose motion is integrated, of each model."""


def row_differences(scene: LoggedScene) -> Iterator[str]:
    """What is wrong with rows."""
    last = len(scene.times) - 1
    for row in _some(range(last + 1), ROWS):
        state = scene.state(row)
        yield from _sums(scene, state, row)
        yield from _grasps(scene, state, row)
        yield from _sensors(scene, state, row)
    # Gaps are evaluated every 20 ms.
    evaluated = [k for k, time in enumerate(scene.times) if abs(time / 0.02 - round(time / 0.02)) < 1e-9]
    for row in _some(evaluated, GAP_ROWS):
        yield from _gaps(scene, scene.state(row), row)
    for model in scene.models:
        for row in _some([k for k in range(last) if _is_free(scene, model, k)], INTERVALS):
            yield from _motion(scene, model, row)


def _some(rows: Sequence[int], most: int) -> list[int]:
    """A number of rows, evenly spread."""
    return sorted({rows[round(x)] for x in np.linspace(0, len(rows) - 1, most)}) if rows else []


def _sums(scene: LoggedScene, state: State, row: int) -> Iterator[str]:
    energies = {name: state.kinetic(name) for name in scene.models}
    momenta = {name: state.momentum(name) for name in scene.models}
    elastic = {name: state.elastic(name) for name in scene.models}
    objects = [name for name in scene.models if name != "robot"]
    scale = sum(energies.values()) + sum(float(np.abs(each).sum()) for each in momenta.values())
    for part, names in (("total", scene.models), ("robot", ["robot"]), ("objects", objects)):
        energy = sum(energies[name] for name in names)
        yield from _beyond(f"row: energy of {part}", energy - scene.run[f"energy.{part}_J"][row], ROUNDING * (1.0 + scale))
        momentum = sum((momenta[name] for name in names), np.zeros(6))
        logged = scene.columns(f"momentum.{part}_")[row][:6]
        yield from _beyond(f"row: momentum of {part}", momentum - logged, ROUNDING * (1.0 + scale))
        key = f"energy.{part}_elastic_J"
        if key in scene.run.keys:
            off = sum(elastic[name] for name in names) - scene.run[key][row]
            yield from _beyond(f"row: elastic energy of {part}", off, ROUNDING * (1.0 + scale))


def _grasps(scene: LoggedScene, state: State, row: int) -> Iterator[str]:
    """No closed latch moves; those beyond the first are kept by a projection of drift, to 1e-8."""
    rows = latches(scene, state, scene.closed(scene.times[row]))
    yield from _beyond("row: velocity of a closed latch", rows @ state.v, 1e-8 * (1.0 + np.linalg.norm(state.v)))


def _gaps(scene: LoggedScene, state: State, row: int) -> Iterator[str]:
    """Gaps of rules between bounds by supports; that of a union is the least of its pieces."""
    for name in scene.rules:
        key, pairs = f"contact.{name.replace('-', '_')}_gap_m", list(scene.shapes(state, name))
        kinds = "-".join(sorted({shape.kind for pair in pairs for shape in pair}))
        if key not in scene.run.keys or not pairs or any(kind in kinds for kind in (*UNKNOWN, "cone")):
            continue
        lower, upper = np.min([distance_bounds(a, b) for a, b in pairs], axis=0)
        gap = scene.run[key][row]
        level = max(scene.rounding(a) + scene.rounding(b) for a, b in pairs) + 2e-9
        if lower > 0.0:
            yield from _beyond(f"row: gap of {kinds}", max(lower - gap, gap - upper, 0.0), level)
        else:
            yield from _beyond(f"row: gap of {kinds} that overlap", max(gap, 0.0), level + upper)


def _sensors(scene: LoggedScene, state: State, row: int) -> Iterator[str]:
    """True values of sensors of pose and rate that are sampled at the time of the row."""
    text = scene.sensors
    for name, kind, of in text:
        start = f"sensor.robot_{name}"
        if f"{start}_sampled_s" not in scene.run.keys or scene.run[f"{start}_sampled_s"][row] != scene.times[row]:
            continue
        true = np.array([scene.run[key][row] for key in scene.run.keys if key.startswith(f"{start}_true")])
        mine = _value(scene, state, kind, of)
        if kind == "framequat":
            true = true * np.sign(true @ mine)
        yield from _beyond(f"row: sensor {kind}", true - mine, 1e-9 * (1.0 + np.linalg.norm(mine)))


def _value(scene: LoggedScene, state: State, kind: str, of: str) -> Array:
    if kind in ("jointpos", "jointvel"):
        joint = scene.bodies.joints[of]
        return np.array([state.q[joint.q] if kind == "jointpos" else state.v[joint.v]])
    place = scene.bodies.sites[of]
    at, frame = state.place(place)
    linear, angular = (rows @ state.v for rows in state.jacobian(place.body, at))
    return {
        "framepos": lambda: at,
        "framequat": lambda: Rotation.from_matrix(frame).as_quat(scalar_first=True),
        "framexaxis": lambda: frame[:, 0],
        "frameyaxis": lambda: frame[:, 1],
        "framezaxis": lambda: frame[:, 2],
        "framelinvel": lambda: linear,
        "frameangvel": lambda: angular,
        "gyro": lambda: frame.T @ angular,
        "velocimeter": lambda: frame.T @ linear,
    }[kind]()


def _is_free(scene: LoggedScene, model: str, row: int) -> bool:
    """Whether nothing but its actuators, springs and gravity acts on a model from a row to the next."""
    start, end = scene.times[row], scene.times[row + 1]
    if any(start - 1e-9 < record.time_s < end + 1e-9 for record in scene.events) or scene.closed(end):
        return False
    modes = [
        f"contact.{name.replace('-', '_')}_mode"
        for name, rule in scene.rules.items()
        if any(side.partition("/")[0] == model for side in rule["between"])
    ]
    if not scene.rules:
        modes = [key for key in scene.run.keys if key.startswith("contact.") and key.endswith("_mode")]
    modes += [key for key in scene.run.keys if key.startswith(f"contact.{model}_") and key.endswith("_limit")]
    return not any(scene.run[key][k] for key in modes for k in (row, row + 1) if key in scene.run.keys)


def _motion(scene: LoggedScene, model: str, row: int) -> Iterator[str]:
    """The next state by an integrator of order eight; the program may be off by what a classical RK4 step is off."""
    coordinates, rates = scene.bodies.of_model(model)
    efforts = {name: values[row] for name, values in scene.efforts.items() if name.startswith(f"{model}/")}
    y = np.concatenate([scene.q[row][coordinates], scene.v[row][rates], np.zeros(7)])
    split = coordinates.stop - coordinates.start

    def slope(_: float, y: Array) -> Array:
        q, v = scene.q[row].copy(), np.zeros(scene.bodies.nv)
        q[coordinates], v[rates] = y[:split], y[split:-7]
        state = State(scene.bodies, q, v)
        M = state.mass_matrix()[rates, rates]
        push, external = state.pushed(efforts)
        force = push + state.springs(model) - state.bias(model, scene.gravity)
        return np.concatenate(
            [_speeds(scene, model, q, v)[coordinates], np.linalg.solve(M, force[rates]), external, [push @ v]]
        )

    length = scene.times[row + 1] - scene.times[row]
    exact = solve_ivp(slope, (0.0, length), y, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    # The program's steps have an error of the same order and size as those of RK4 with the step of the scenario. For a turn
    # by x in a step that is x^5 / 120, with another factor for each way to write a rotation; ten times that is a bound.
    steps = max(1, round(length / scene.said["time_step_s"]))
    rough = y.copy()
    for _ in range(steps):
        rough = _runge_kutta(slope, rough, length / steps)
    size = 1.0 + float(np.abs(exact).max())
    turn = length / steps * sum(float(np.linalg.norm(scene.v[k][rates])) for k in (row, row + 1)) / 2.0
    allowed = 30.0 * float(np.abs(rough - exact).max()) + (ROUNDING + steps * turn**5 / 12.0) * size
    logged = np.concatenate([scene.q[row + 1][coordinates], scene.v[row + 1][rates]])
    yield from _beyond(
        f"motion of {'robot' if model == 'robot' else 'object'}", _apart(scene, model, exact[:-7], logged), allowed
    )
    if model == "robot":
        external = scene.columns("balance.external_")
        off = exact[-7:-1] - (external[row + 1] - external[row])
        yield from _beyond("motion: impulse of thrusters", off, allowed)
        work = scene.run["balance.work_J"]
        yield from _beyond("motion: work of actuators", exact[-1] - (work[row + 1] - work[row]), allowed)


def _speeds(scene: LoggedScene, model: str, q: Array, v: Array) -> Array:
    """Rates of change of coordinates."""
    speed = np.zeros(scene.bodies.nq)
    for name, joint in scene.bodies.joints.items():
        if name.startswith(f"{model}/"):
            at, d, (count, _) = joint.q, joint.v, WIDTHS[joint.kind]
            if joint.kind == "free":
                speed[at : at + 3], at, d, count = v[d : d + 3], at + 3, d + 3, 4
            if count == 4:
                w, x, y, z = q[at : at + 4]
                speed[at : at + 4] = 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) @ v[d : d + 3]
            else:
                speed[at] = v[d]
    return speed


def _apart(scene: LoggedScene, model: str, mine: Array, logged: Array) -> Array:
    """Differences of two states, of which quaternions may have opposite signs."""
    coordinates, _ = scene.bodies.of_model(model)
    mine = mine.copy()
    for name, joint in scene.bodies.joints.items():
        if name.startswith(f"{model}/") and joint.kind in ("free", "ball"):
            at = joint.q + WIDTHS[joint.kind][0] - 4 - coordinates.start
            quat = mine[at : at + 4] / np.linalg.norm(mine[at : at + 4])
            mine[at : at + 4] = quat * np.sign(quat @ logged[at : at + 4])
    return mine - logged


def _runge_kutta(slope: Any, y: Array, h: float) -> Array:
    a = slope(0.0, y)
    b = slope(0.0, y + 0.5 * h * a)
    c = slope(0.0, y + 0.5 * h * b)
    d = slope(0.0, y + h * c)
    return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
