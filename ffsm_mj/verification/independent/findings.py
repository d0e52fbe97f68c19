"""All independent checks of a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ffsm_mj.model.system import System
from ffsm_mj.records.run_log import RunLog
from ffsm_mj.verification.independent.contact_geometry import contact_geometry
from ffsm_mj.verification.independent.equalities import equalities
from ffsm_mj.verification.independent.finding import Finding
from ffsm_mj.verification.independent.friction_heat import friction_heat
from ffsm_mj.verification.independent.grasp_bounds import grasp_bounds
from ffsm_mj.verification.independent.grasp_load import grasp_load
from ffsm_mj.verification.independent.grasps import grasps
from ffsm_mj.verification.independent.kept_rows import KeptRows
from ffsm_mj.verification.independent.logged_rows import LoggedRows
from ffsm_mj.verification.independent.restitution import restitution_used
from ffsm_mj.verification.independent.scene import LoggedScene
from ffsm_mj.verification.independent.sensor_errors import sensor_noise
from ffsm_mj.verification.independent.sensor_settings import SensorSettings, sensor_settings
from ffsm_mj.verification.independent.sensor_times import sensor_times
from ffsm_mj.verification.independent.sensor_values import sensor_values
from ffsm_mj.verification.independent.several_contacts import several_contacts


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
