"""Text of an impact map for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from ffsm_mj.impact_maps.configuration import Configuration
from ffsm_mj.impact_maps.impact_map import ImpactMap
from ffsm_mj.report.text_table import table, wrapped

_SHOWN = {
    "impulse_N_s": ("impulse\nN s", "impulse"),
    "effective_mass_kg": ("eff. mass\nkg", "effective mass"),
    "base_rate_change_rad_s": ("base rate\nrad/s", "base rate"),
    "joint_rate_change": ("joint rate\nrad/s", "joint rate"),
    "object_spin_rad_s": ("object spin\nrad/s", "object spin"),
}
"""Effects of the table: head of the column, and words."""
_KEPT = {
    "com": "with the robot's centre of mass where it is in the run",
    "base": "with the base where it is in the run",
    "nothing": "with the base anywhere",
}


def lines(mapped: ImpactMap, hold: str) -> Iterator[str]:
    """Contact, counts, and a table of the run, the best configuration and the extremes."""
    target = mapped.target
    place, normal = (", ".join(f"{x + 0.0:.6g}" for x in v) for v in (target.contact.point, target.outward))
    yield wrapped(
        f"contact of {target.pair} at ({place}) m, normal ({normal}): approach {target.approach_speed:.4g} m/s, "
        f"e = {target.contact.restitution:g}, mu = {target.contact.mu:g}",
        2,
    )
    counts = {status: sum(each.status == status for each in mapped.configurations) for status in ("overlap", "no rates")}
    said = "".join(f"; {counts[name]} {words}" for name, words in _COUNTED.items() if counts[name])
    yield wrapped(f"{mapped.reached} of {mapped.drawn} drawn configurations reach it {_KEPT[hold]}{said}", 2)
    head = ("configuration", *(head for head, _ in _SHOWN.values()), "status")
    yield table(head, _rows(mapped), spare=("joint rate", "eff. mass"))


_COUNTED = {"overlap": "of all have overlapping geoms", "no rates": "cannot arrive with the velocity of the run"}


def _rows(mapped: ImpactMap) -> Iterator[tuple[str, ...]]:
    if mapped.of_run is not None:
        yield _row("as in the run", mapped.of_run)
    most = "largest" if mapped.objective.maximize else "least"
    yield _row(f"best ({most} {_SHOWN.get(mapped.objective.effect, ('', mapped.objective.effect))[1]})", mapped.best)
    allowed = [each for each in mapped.configurations if mapped.allows(each)]
    for effect in ("impulse_N_s", "base_rate_change_rad_s", "object_spin_rad_s"):
        for word, choose in (("least", min), ("largest", max)):
            found = choose(allowed, key=lambda each: each.effects[effect])
            if found is not mapped.best and found is not mapped.of_run:
                yield _row(f"{word} {_SHOWN[effect][1]}", found)


def _row(name: str, configuration: Configuration) -> tuple[str, ...]:
    return (name, *(f"{configuration.effects[effect]:.5g}" for effect in _SHOWN), configuration.status)
