"""All independent checks of a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ffsm_mj.model.system import System
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.independent.field_impulses import field_impulses
from ffsm_mj.verification.independent.finding import Finding
from ffsm_mj.verification.independent.grasps import grasp_bounds, grasp_load, grasps
from ffsm_mj.verification.independent.impacts import (
    contact_geometry,
    equalities,
    friction_heat,
    restitution_used,
    several_contacts,
)
from ffsm_mj.verification.independent.kept_rows import KeptRows
from ffsm_mj.verification.independent.scene import LoggedRows, LoggedScene
from ffsm_mj.verification.independent.sensors import (
    SensorSettings,
    sensor_noise,
    sensor_settings,
    sensor_times,
    sensor_values,
)


def independent_findings(log: RunLog, kept: KeptRows, system: System, scenario: Mapping[str, Any]) -> list[Finding]:
    """Worst residual of each check; what a log has no columns, no records or not all rows for is left out.

    Args:
        log: The log: header, records and damage.
        kept: Rows of the log.
        system: Its compiled models, without a closed grasp.
        scenario: Its scenario as plain data.
    """
    scene = _or_none(lambda: LoggedScene(log, kept.layout, system, scenario))
    if scene is None or not kept.count:
        return []
    rows = LoggedRows(log, kept)
    sensors: list[SensorSettings] = _or_none(lambda: sensor_settings(scene)) or []
    checks: tuple[Callable[[], list[Finding]], ...] = (
        lambda: restitution_used(scene, rows),
        lambda: friction_heat(log, rows),
        lambda: grasp_load(scene, rows),
        lambda: sensor_values(scene, rows, sensors),
        lambda: sensor_times(rows, sensors),
        lambda: sensor_noise(rows, sensors),
        lambda: grasps(scene, rows),
        lambda: equalities(scene),
        lambda: grasp_bounds(scene, rows),
        lambda: contact_geometry(scene),
        lambda: several_contacts(scene, rows),
        lambda: field_impulses(scene, rows),
    )
    return [finding for check in checks for finding in _or_none(check) or []]


def _or_none(check: Callable[[], Any]) -> Any:
    """What a check finds; None where the log is not of a kind that it can read: a log may hold anything.

    What is wrong with such a log the balances, the replay and the reader of the log say.
    """
    try:
        with np.errstate(all="ignore"):
            return check()
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, np.linalg.LinAlgError):
        return None
