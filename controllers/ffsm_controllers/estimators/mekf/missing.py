"""What a filter needs to be measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ffsm_controllers.estimators.mekf.frame_measurement import FrameMeasurement
from ffsm_controllers.estimators.mekf.layout import FloatingBody
from ffsm_mj.controller_protocol import Fault

_NEEDED = {"framepos": "position", "framequat": "attitude"}


def missing_measurements(bodies: Sequence[FloatingBody], measurements: Iterable[FrameMeasurement]) -> list[Fault]:
    """Bodies whose position or attitude is measured neither relative to the world nor to a body of which it is."""
    measured, faults = list(measurements), []
    for kind, what in _NEEDED.items():
        links = [{_name(each.body), _name(each.other)} for each in measured if each.kind == kind]
        known = {""}
        while grown := [link for link in links if link & known and not link <= known]:
            known = known.union(*grown)
        for body in bodies:
            if body.name not in known:
                text = (
                    f"no sensor measures the {what} of {body.name!r}: a filter needs a <{kind}> of it relative to the world"
                )
                faults.append(Fault(f"{text}, or to a body whose {what} is measured", ("kind",)))
    return faults


def _name(body: object) -> str:
    """Name of a floating body; empty for the world."""
    return str(getattr(body, "name", ""))
