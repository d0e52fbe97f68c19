"""The table ``angular_momentum`` of a run."""

from __future__ import annotations

from typing import Any

from ffsm_mj.records.record import Values, declared, record

_NONE = (float("nan"),) * 3


@record
class MomentumRow:
    """A row of the table: vectors in world axes about the centre of mass of everything that moves."""

    kind: str = declared("Total, outside, subsystem, body, or actuator: wheel, external or joint.")
    name: str = declared("Name of the subsystem, body or actuator.")
    before_N_m_s: Values = declared("Angular momentum at the first sample; NaN for actuators.", components="xyz")
    after_N_m_s: Values = declared("Angular momentum at the last sample; NaN for actuators.", components="xyz")
    change_N_m_s: Values = declared(
        "Difference; of actuators what a wheel stores and what a thruster brings.", components="xyz"
    )


def momentum_rows(found: dict[str, Any] | None) -> list[MomentumRow]:
    """Rows of the table from ``angular_momentum`` of ``summary.json``; none without it."""
    if found is None:
        return []
    rows = [_changed("total", "total", found["initial_N_m_s"], found["final_N_m_s"])]
    rows.append(MomentumRow("outside", "outside", _NONE, _NONE, tuple(found["external_N_m_s"])))
    for kind, key in (("subsystem", "subsystems"), ("body", "bodies")):
        rows += [_changed(kind, name, each["before_N_m_s"], each["after_N_m_s"]) for name, each in found[key].items()]
    rows += [
        MomentumRow(each["kind"], name, _NONE, _NONE, tuple(each["taken_N_m_s"]))
        for name, each in found["actuators"].items()
    ]
    return rows


def _changed(kind: str, name: str, before: list[float], after: list[float]) -> MomentumRow:
    change = tuple(y - x for x, y in zip(before, after, strict=True))
    return MomentumRow(kind, name, tuple(before), tuple(after), change)
