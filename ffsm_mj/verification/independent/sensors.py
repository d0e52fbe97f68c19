"""Sensors of a log: their settings, which sample a row shows, true values at its state, and measured values made again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any
from zlib import crc32

import mujoco
import numpy as np

from ffsm_mj.model.sensors import ModelSensor
from ffsm_mj.records.metadata import logged_start_s
from ffsm_mj.records.sensing_columns import measured_columns
from ffsm_mj.records.signals import identifier
from ffsm_mj.verification.independent.finding import SENSOR_NOISE, SENSOR_TIMES, SENSOR_VALUES, Array, Finding, Worst
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S
from ffsm_mj.verification.independent.scene import (
    Latched,
    LoggedRows,
    LoggedScene,
    accelerate,
    forces_known,
    is_out_of_contact,
    load_on,
)


@dataclass(frozen=True)
class SensorSettings:
    """A sensor of a log.

    Attributes:
        model: The sensor of its model.
        settings: What the scenario sets for it.
        measured: Columns of its measured value.
        true: Columns of its true value.
        sampled: Column of the time of the sample.
        seed: Seed of the run.
        start_s: Start of the run, s.
        interval_s: Time between samples, s.
        first_s: Time of the first sample, s.
        delay_s: Least time from a sample to its arrival, s.
    """

    model: ModelSensor
    settings: Mapping[str, Any]
    measured: tuple[int, ...]
    true: tuple[int, ...]
    sampled: int
    seed: int
    start_s: float
    interval_s: float
    first_s: float
    delay_s: float

    @property
    def name(self) -> str:
        """Full name."""
        return self.model.name

    def value(self, key: str, default: Any) -> Any:
        """What the scenario sets under a key, or a default."""
        setting = self.settings.get(key)
        return default if setting is None else setting

    def numbers(self, block: Array) -> Array:
        """Numbers of the samples that some rows show, (n,); NaN before the first arrival."""
        return np.asarray(np.round((block[:, self.sampled] - self.first_s) / self.interval_s))


def sensor_settings(scene: LoggedScene) -> list[SensorSettings]:
    """The sensors of a log whose columns it has.

    Raises:
        LookupError: The scenario names a sensor that the models do not have, or a column is missing.
    """
    layout, system, scenario, metadata = scene.layout, scene.system, scene.scenario, scene.log.header.metadata
    period_s = float(metadata.get("control_period_s", "nan"))
    stated = {system.resolve("sensor", key): dict(part) for key, part in (scenario.get("sensors") or {}).items()}
    settings = []
    for columns in measured_columns(layout, system.sensors):
        model, changes = system.sensors[columns.sensor], stated.get(columns.sensor, {})
        timing = {
            name: changes[name] if changes.get(name) is not None else getattr(model, name)
            for name in ("interval_s", "first_s", "delay_s")
        }
        timing["interval_s"] = timing["interval_s"] or period_s
        settings.append(
            SensorSettings(
                model,
                changes,
                tuple(layout.index[key] for key in columns.measured),
                tuple(layout.index[key] for key in columns.true),
                layout.index[f"sensor.{identifier(columns.sensor)}_sampled_s"],
                int(scenario.get("seed") or 0),
                logged_start_s(metadata),
                **timing,
            )
        )
    return settings


_BLOCK = 256


class SensorErrors:
    """Makes the measured values of one sensor again from true values and the random numbers of its own channel.

    The noise of a channel is documented in docs/sensors.md: sample n of a sensor takes row n mod 256 of the table of 256
    rows of standard normal numbers that NumPy's Philox draws with the key (seed, CRC-32 of the sensor's name) and the
    counter (0, 0, n div 256, 0). Random walks of biases, lost samples and jitter of delays have names of their own.
    """

    def __init__(self, sensor: SensorSettings) -> None:
        """Take its errors from models and scenario."""
        self.sensor, of = sensor, sensor.value
        self._size = len(sensor.true) if sensor.model.shape == "vector" else 3
        self._draws = cache(self._drawn)
        interval_s = sensor.interval_s
        density = of("noise_density", None)
        self._noise = np.array(of("noise", sensor.model.noise) if density is None else density) / (
            1.0 if density is None else np.sqrt(interval_s)
        )
        self._walk = of("bias_walk", 0.0) * np.sqrt(interval_s)
        self._bias, self._scale = (np.broadcast_to(of(key, 0.0), self._size) for key in ("bias", "scale_error"))
        self._frame = _turn(np.array([of("misalignment_rad", (0.0, 0.0, 0.0))], dtype=float))[0].T
        cutoff = of("cutoff", sensor.model.cutoff) or np.inf
        low, high = of("range", (-np.inf, np.inf))
        self._low, self._high, self._quantum = max(low, -cutoff), min(high, cutoff), of("quantum", 0.0)

    def _drawn(self, purpose: str, block: int) -> Array:
        """Normal numbers of a block of samples, (256, size); of lost samples and jitter uniform ones, (256, 1)."""
        key = np.array((self.sensor.seed, crc32((self.sensor.name + purpose).encode())), dtype=np.uint64)
        generator = np.random.Generator(np.random.Philox(key=key, counter=np.array((0, 0, block, 0), dtype=np.uint64)))
        if purpose in ("/dropout", "/delay_jitter"):
            return np.asarray(generator.random((_BLOCK, 1)))
        return generator.standard_normal((_BLOCK, self._size))

    def draws(self, purpose: str, samples: Array) -> Array:
        """Random numbers of some samples, (n, size)."""
        numbers = samples.astype(int)
        blocks = numbers // _BLOCK
        out = np.empty((len(numbers), self._draws(purpose, 0).shape[1]))
        for block in np.unique(blocks):
            out[blocks == block] = self._draws(purpose, int(block))[numbers[blocks == block] % _BLOCK]
        return out

    def errors(self, samples: Array) -> Array:
        """Bias, its walk and noise of some samples, (n, size)."""
        added = np.tile(self._bias, (len(samples), 1))
        if self._walk:
            every = np.arange(1.0, max(float(samples.max()), 1.0) + 1.0)
            path = np.vstack((np.zeros(self._size), np.cumsum(self.draws("/bias_walk", every), axis=0)))
            added += self._walk * path[samples.astype(int)]
        return np.asarray(added + self._noise * self.draws("", samples) if self._noise.any() else added)

    def residual(self, samples: Array, true: Array, measured: Array) -> Array:
        """Measured values less those made again, (n, number of components)."""
        shape, errors = self.sensor.model.shape, self.errors(samples)
        if shape == "rotation":
            return measured - _product(true, _quaternions(errors))
        if shape == "direction":
            return np.asarray(measured - np.einsum("nij,nj->ni", _turn(errors), true))
        value = true @ self._frame.T if true.shape[1] == 3 else true
        value = np.clip(value * (1.0 + self._scale) + errors, self._low, self._high)
        if not self._quantum:
            return np.asarray(measured - value)
        away = measured - self._quantum * np.round(value / self._quantum)
        # A value half-way between two steps, to rounding, may be rounded to either.
        tie = np.abs(np.abs(value / self._quantum % 1.0) - 0.5) < 1e-9
        return np.where(tie & (np.abs(away) < 1.5 * self._quantum), 0.0, away)


def sensor_noise(rows: LoggedRows, sensors: Sequence[SensorSettings]) -> list[Finding]:
    """Worst difference of measured values from those made again, each in the unit of its sensor."""
    worst, kept = Worst(SENSOR_NOISE), rows.kept
    for sensor in sensors:
        shown = [kept[number] for number, _ in kept.samples[sensor.sampled].kept if number in kept]
        block = np.array([row for row in shown if not np.isnan(row[list(sensor.true)]).any()])
        if not len(block):
            continue
        true, measured = block[:, list(sensor.true)], block[:, list(sensor.measured)]
        away = np.abs(SensorErrors(sensor).residual(sensor.numbers(block), true, measured)).max(axis=1)
        at = int(np.argmax(np.where(np.isnan(away), np.inf, away)))
        worst.add(sensor.name, away[at], true, float(block[at, sensor.sampled]), sensor.model.unit)
    return worst.findings


def _quaternions(turns: Array) -> Array:
    """Unit quaternions of rotation vectors, (n, 4)."""
    angles = np.linalg.norm(turns, axis=1, keepdims=True)
    # sin(a / 2) / a, by NumPy's sin(pi x) / (pi x).
    return np.hstack((np.cos(0.5 * angles), 0.5 * np.sinc(0.5 * angles / np.pi) * turns))


def _product(first: Array, second: Array) -> Array:
    """Products of quaternions, (n, 4)."""
    a, u, b, v = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    return np.hstack((a * b - np.sum(u * v, axis=1, keepdims=True), a * v + b * u + np.cross(u, v)))


def _turn(turns: Array) -> Array:
    """Rotation matrices of rotation vectors, (n, 3, 3)."""
    w, v = (part for part in np.split(_quaternions(turns), (1,), axis=1))
    cross = np.cross(np.eye(3)[None], v[:, None, :])  # rows e_i x v
    outer = v[:, :, None] * v[:, None, :]
    return np.asarray((2.0 * w[..., None] ** 2 - 1.0) * np.eye(3) + 2.0 * outer + 2.0 * w[..., None] * cross)


def sensor_times(rows: LoggedRows, sensors: Sequence[SensorSettings]) -> list[Finding]:
    """Worst difference of the times of the samples that rows show from those of the newest that have arrived, s."""
    worst, kept = Worst(SENSOR_TIMES), rows.kept
    for sensor in sensors:
        numbers = {*kept.spread.kept, *(number for number, _ in kept.samples[sensor.sampled].kept)}
        block = np.array([kept[number] for number in sorted(numbers) if number in kept])
        times, shown, errors = block[:, kept.layout.time], block[:, sensor.sampled], SensorErrors(sensor)
        # An arrival at the time of a row may be seen by it or, by rounding, not yet.
        sooner, later = (_newest(errors, times + shift) for shift in (-2.0 * SAME_TIME_S, 2.0 * SAME_TIME_S))
        away = np.minimum(_apart(shown, sooner), _apart(shown, later))
        if sensor.start_s:
            # Samples of before the start of a run that goes on from another are not known to it.
            away = np.where(sooner > sensor.start_s, away, 0.0)
        at = int(np.argmax(away))
        worst.add(sensor.name, away[at], 0.0, float(times[at]), "s")
    return worst.findings


def _newest(errors: SensorErrors, times: Array) -> Array:
    """Time of the newest sample that has arrived at each time, (n,); NaN if none has."""
    sensor = errors.sensor
    jitter_s, dropout = float(sensor.value("delay_jitter_s", 0.0)), float(sensor.value("dropout", 0.0))
    last = np.floor((times - sensor.delay_s - sensor.first_s) / sensor.interval_s)
    if not jitter_s and not dropout:
        return np.where(last >= 0.0, sensor.first_s + last * sensor.interval_s, np.nan)
    samples = np.arange(0.0, max(float(last.max()), 0.0) + 1.0)
    arrivals = sensor.first_s + samples * sensor.interval_s + sensor.delay_s
    if jitter_s:
        arrivals = arrivals + jitter_s * errors.draws("/delay_jitter", samples)[:, 0]
    if dropout:
        arrivals = np.where(errors.draws("/dropout", samples)[:, 0] < dropout, np.inf, arrivals)
    order = np.argsort(arrivals)
    newest = np.maximum.accumulate(samples[order])
    place = np.searchsorted(arrivals[order], times, side="right") - 1
    return np.where(place >= 0, sensor.first_s + newest[place] * sensor.interval_s, np.nan)


def _apart(shown: Array, expected: Array) -> Array:
    """Distance of times, s; 0 where neither is known, infinite where one is not."""
    away = np.abs(shown - expected)
    return np.where(np.isnan(shown) & np.isnan(expected), 0.0, np.where(np.isnan(away), np.inf, away))


_OF_FORCES = (
    *("accelerometer", "force", "torque", "framelinacc", "frameangacc", "touch"),
    *("actuatorfrc", "jointactuatorfrc", "tendonactuatorfrc"),
)
"""Kinds whose value depends on forces or accelerations."""


def sensor_values(scene: LoggedScene, rows: LoggedRows, sensors: Sequence[SensorSettings]) -> list[Finding]:
    """Worst difference of logged true values from those at the states of the samples, each in the unit of its sensor.

    Samples inside of steps have no row and are left out, as are values of forces where contacts exert them: the forces of a
    row are those under its new efforts, and a sample is taken before these are decided.
    """
    worst, known = Worst(SENSOR_VALUES), rows.is_whole and forces_known(scene)
    due: dict[int, list[tuple[SensorSettings, Array]]] = {}
    for sensor in sensors:
        for shown, at in rows.kept.samples[sensor.sampled].kept:
            if at in rows.kept and shown in rows.kept and not rows.is_at_event(at):
                due.setdefault(at, []).append((sensor, rows.kept[shown][list(sensor.true)]))
    for at, samples in due.items():
        loads = _put(scene, rows, at, with_forces=known and any(s.model.kind in _OF_FORCES for s, _ in samples))
        closed = scene.closed_in(rows.kept[at])
        for sensor, logged in samples:
            if np.isnan(logged).any() or (loads is None and sensor.model.kind in _OF_FORCES):
                continue  # the joint is gone while a grasp is closed, or forces are not known
            if closed and sensor.model.kind.startswith("subtree"):
                continue  # MuJoCo's subtree of a link contains what it grasps
            value = _value(scene, sensor, loads or ())
            if sensor.model.shape == "rotation" and value @ logged < 0.0:
                value = -value  # both signs are one orientation
            worst.add(sensor.name, value - logged, logged, rows.time_s(at), sensor.model.unit)
    return worst.findings


def _value(scene: LoggedScene, sensor: SensorSettings, loads: Sequence[_Load]) -> Array:
    """True value of a sensor at the state in the data, whose surroundings MuJoCo does not know."""
    data, kind, fields = scene.data, sensor.model.kind, scene.fields
    value = np.array(data.sensor(sensor.name).data)
    if kind == "startracker" and fields.orbit is not None and sensor.value("axes", "world") == "eci":
        attitude = np.empty(4)
        mujoco.mju_mat2Quat(attitude, fields.orbit.axes.ravel())
        return np.asarray(_product(attitude[None], value[None])[0])
    if kind not in ("accelerometer", "horizon", "magnetometer", "force", "torque"):
        return value
    site = int(scene.model.sensor(sensor.name).objid[0])
    place, axes = data.site_xpos[site], data.site_xmat[site].reshape(3, 3)
    if kind in ("force", "torque"):
        return _wrench(scene, sensor, site, value, loads)
    if kind == "horizon" and fields.orbit is not None:
        down = -(fields.orbit.position(data.time) + place) @ axes
        return np.asarray(down / np.linalg.norm(down))
    if kind == "magnetometer":
        return value if fields.magnetic is None else np.asarray(fields.magnetic.at(data.time, place) @ axes)
    # Of an accelerometer MuJoCo takes off uniform gravity alone.
    return np.asarray(value - fields.acceleration(data.time, place) @ axes)


def _wrench(scene: LoggedScene, sensor: SensorSettings, site: int, whole: Array, loads: Sequence[_Load]) -> Array:
    """Force or torque at a site, or its part, from that without loads on what a grasp joins."""
    data, of_grasps, carrier = scene.data, np.zeros(3), int(scene.model.site_bodyid[site])
    for link, child, point, (force, torque) in loads:
        moment = torque + np.cross(point - data.site_xpos[site], force)
        load = (moment if sensor.model.kind == "torque" else force) @ data.site_xmat[site].reshape(3, 3)
        if carrier == child:
            whole = whole + load  # in a run the object is a child of the link, here it is not
        elif carrier in _to_the_world(scene, link):
            of_grasps += load
    # Only rows without contact forces are asked for: what is neither of the tool nor of a grasp is nothing.
    parts = {"contact": np.zeros(3), "grasp": of_grasps, "tool": whole - of_grasps}
    return np.asarray(parts.get(sensor.value("part", ""), whole))


def _to_the_world(scene: LoggedScene, body: int) -> set[int]:
    """A body and all between it and the world."""
    chain = {body}
    while body := int(scene.model.body_parentid[body]):
        chain.add(body)
    return chain


_Load = tuple[int, int, Array, tuple[Array, Array]]
"""A body that holds an object, the object, a point in world axes, and force and torque about it on the object."""


def _put(scene: LoggedScene, rows: LoggedRows, at: int, *, with_forces: bool) -> tuple[_Load, ...] | None:
    """Put the data to the state of a row as a sample sees it.

    Returns:
        What is exerted on held objects by what holds them; None if sensors of forces are not evaluated.
    """
    model, data, row, efforts = scene.model, scene.data, rows.kept[at], None
    if with_forces and is_out_of_contact(scene, row):
        # At t = 0, before the first command, nothing is powered; a run that goes on from another has its efforts.
        is_start = at == 0 and not logged_start_s(scene.log.header.metadata)
        efforts = np.zeros(model.nu) if is_start else rows.efforts_after(scene, at - 1, rows.time_s(at))
    scene.put_row(row, np.zeros(model.nu) if efforts is None else efforts)
    mujoco.mj_sensorPos(model, data)
    mujoco.mj_sensorVel(model, data)
    if efforts is None:
        return None
    closed = scene.closed_in(row)
    if len(closed) > 1:
        return None  # how they share the load is not known
    accelerate(scene, closed)
    loads = (_load(scene, closed[0]),) if closed else ()
    mujoco.mj_sensorAcc(model, data)
    return loads


def _load(scene: LoggedScene, closed: Latched) -> _Load:
    """Put the load of a grasp on its object and on what holds it."""
    model, data, point = scene.model, scene.data, np.array(scene.data.site_xpos[closed.child])
    link, child = scene.bodies(closed)
    load = load_on(scene, int(model.body_rootid[child]), point)
    for body, sign in ((child, 1.0), (link, -1.0)):
        data.xfrc_applied[body, :3] += sign * load[:3]
        data.xfrc_applied[body, 3:] += sign * (load[3:] + np.cross(point - data.xipos[body], load[:3]))
    mujoco.mj_rnePostConstraint(model, data)
    return link, child, point, (load[:3], load[3:])
