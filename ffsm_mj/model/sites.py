"""Sites that a scenario gives a robot, the file untouched: MJCF cannot put one on a body of a model that it attaches."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name


@dataclass(frozen=True)
class AddedSite:
    """A site that the model's file does not have.

    Attributes:
        name: Its name in the model.
        body: Body that it is fixed to, by its name in the model.
        pos_m: Its place in the body's frame, m.
    """

    name: str
    body: str
    pos_m: tuple[float, float, float]


def add_sites(spec: Any, sites: Iterable[AddedSite]) -> None:
    """Put sites into a specification, before it is compiled.

    Args:
        spec: The robot; all its elements have names.
        sites: What it is given.

    Raises:
        ScenarioFaults: There is no such body, or a site of that name already.
    """
    faults = []
    for site in sites:
        body = spec.body(site.body)
        if body is None or body.name == "world":
            names = [each.name for each in spec.bodies[1:]]
            faults.append(Fault(unknown_name("body", site.body, names), ("robot", "sites", site.name, "body")))
        elif site.name in {each.name for each in spec.sites}:
            faults.append(Fault("the model has a site of this name; give it another", ("robot", "sites", site.name)))
        else:
            body.add_site(name=site.name, pos=site.pos_m)
    if faults:
        raise ScenarioFaults(faults)
