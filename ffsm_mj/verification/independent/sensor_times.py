"""Which sample of each sensor a row shows: the newest that has arrived, by interval, delay, jitter and lost samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ffsm_mj.verification.independent.finding import Array, Finding, Worst
from ffsm_mj.verification.independent.kept_rows import SAME_TIME_S
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.sensor_errors import SensorErrors
from ffsm_mj.verification.independent.sensor_settings import SensorSettings
from ffsm_mj.verification.independent.tolerances import SENSOR_TIMES


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
    return worst.found


def _newest(each: SensorErrors, times: Array) -> Array:
    """Time of the newest sample that has arrived at each time, (n,); NaN if none has."""
    sensor = each.sensor
    jitter_s, dropout = float(sensor.value("delay_jitter_s", 0.0)), float(sensor.value("dropout", 0.0))
    last = np.floor((times - sensor.delay_s - sensor.first_s) / sensor.interval_s)
    if not jitter_s and not dropout:
        return np.where(last >= 0.0, sensor.first_s + last * sensor.interval_s, np.nan)
    samples = np.arange(0.0, max(float(last.max()), 0.0) + 1.0)
    arrivals = sensor.first_s + samples * sensor.interval_s + sensor.delay_s
    if jitter_s:
        arrivals = arrivals + jitter_s * each.draws("/delay_jitter", samples)[:, 0]
    if dropout:
        arrivals = np.where(each.draws("/dropout", samples)[:, 0] < dropout, np.inf, arrivals)
    order = np.argsort(arrivals)
    newest = np.maximum.accumulate(samples[order])
    place = np.searchsorted(arrivals[order], times, side="right") - 1
    return np.where(place >= 0, sensor.first_s + newest[place] * sensor.interval_s, np.nan)


def _apart(shown: Array, expected: Array) -> Array:
    """Distance of times, s; 0 where neither is known, infinite where one is not."""
    away = np.abs(shown - expected)
    return np.where(np.isnan(shown) & np.isnan(expected), 0.0, np.where(np.isnan(away), np.inf, away))
