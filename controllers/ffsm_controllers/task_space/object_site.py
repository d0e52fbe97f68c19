"""Sites of objects, by the names that a scenario has for them."""

from __future__ import annotations

from ffsm_mj.controller_protocol import Fault, ScenarioFaults, System


def object_site(system: System, name: str) -> int:
    """Id of a site that is of an object.

    Raises:
        ScenarioFaults: There is none of that name, or it is of the robot; path ``object_site``.
    """
    try:
        full = system.resolve("site", name)
    except LookupError as error:
        raise ScenarioFaults([Fault(str(error.args[0]), ("object_site",))]) from error
    if full.startswith("robot/"):
        sites = [each for each in system.names("site") if not each.startswith("robot/")]
        allowed = f"write one of {', '.join(sites)}" if sites else "add one to an object's model"
        raise ScenarioFaults([Fault(f"{full} is a site of the robot; {allowed}", ("object_site",))])
    return system.index("site", full)
