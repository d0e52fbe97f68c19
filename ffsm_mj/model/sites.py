"""Sites that a scenario adds to the robot: MJCF cannot add a site to a body of an attached model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name


@dataclass(frozen=True)
class AddedSite:
    """A site to add to a model.

    Attributes:
        name: Its name in the model.
        body: Name in the model of the body that it is fixed to.
        pos_m: Position in the frame of the body, (3,), m.
    """

    name: str
    body: str
    pos_m: tuple[float, float, float]


def add_sites(spec: Any, sites: Iterable[AddedSite]) -> None:
    """Add sites to a specification before it is compiled.

    Args:
        spec: Specification of the robot; all its elements have names.
        sites: The sites.

    Raises:
        ScenarioFaults: A body does not exist, or a site of that name exists.
    """
    faults = []
    for site in sites:
        body = spec.body(site.body)
        if body is None or body.name == "world":
            names = [each.name for each in spec.bodies[1:]]
            faults.append(Fault(unknown_name("body", site.body, names), ("robot", "sites", site.name, "body")))
        elif site.name in {each.name for each in spec.sites}:
            faults.append(Fault("the model already has a site of this name; choose another", ("robot", "sites", site.name)))
        else:
            body.add_site(name=site.name, pos=site.pos_m)
    if faults:
        raise ScenarioFaults(faults)
