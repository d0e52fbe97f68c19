"""Static checks of grasps: names, arming and release by phases."""

from __future__ import annotations

from collections.abc import Iterator

from ffsm_controllers import kinds
from ffsm_mj.errors import Fault, unknown_name
from ffsm_mj.records.signals import identifier
from ffsm_mj.scenario.phase_config import PhaseConfig
from ffsm_mj.scenario.phase_graph import is_branching
from ffsm_mj.scenario.scenario import ScenarioConfig

_OWN = "ffsm_controllers"


def grasp_faults(scenario: ScenarioConfig) -> list[Fault]:
    """Faults of grasps in phases: unknown grasps, and a grasp armed while it is closed."""
    faults = []
    for i, phase in enumerate(scenario.phases):
        for key, names in (("arm", phase.arm), ("release", phase.release)):
            unknown = ((k, name) for k, name in enumerate(names) if name not in scenario.grasps)
            faults += [Fault(unknown_name("grasp", name, scenario.grasps), ("phases", i, key, k)) for k, name in unknown]
    first: dict[str, str] = {}
    for name in scenario.grasps:
        other = first.setdefault(identifier(name), name)
        if other != name:
            faults.append(Fault(f"its columns would have the names of those of {other!r}; rename it", ("grasps", name)))
    if is_branching(scenario.phases):
        return faults  # what was armed or closed before depends on the way that the run takes
    return faults or [*_armed_while_closed(scenario), *_ends_at_no_grasp(scenario)]


def never_armed(scenario: ScenarioConfig) -> Iterator[str]:
    """Messages for grasps that no phase arms; a control law may still request them."""
    armed = {name for phase in scenario.phases for name in phase.arm}
    asking = [phase.name for phase in scenario.phases if not _asks_for_nothing(phase)]
    for name in scenario.grasps:
        if name not in armed:
            law = f" unless the control law of phase {asking[0]!r} requests it" if asking else ""
            yield f"no phase arms the grasp {name!r}, so it never closes{law}; write 'arm: [{name}]' in a phase"


def _ends_at_no_grasp(scenario: ScenarioConfig) -> Iterator[Fault]:
    """Phases that wait for a grasp that cannot close: no grasp is armed, and no control law may request one."""
    for i, phase in enumerate(scenario.phases):
        if not _asks_for_nothing(phase):
            return
        if phase.until == "grasp" and phase.for_s is None and not phase.arm and scenario.grasps:
            message = f"no grasp is armed, so none ends this phase; write 'arm: [{next(iter(scenario.grasps))}]'"
            yield Fault(message, ("phases", i, "until"))


def _armed_while_closed(scenario: ScenarioConfig) -> Iterator[Fault]:
    """Grasps that a phase arms while they are certainly closed: alone armed they ended a phase, and nothing ended them."""
    closed: dict[str, str] = {}
    for i, phase in enumerate(scenario.phases):
        closed = {name: since for name, since in closed.items() if name not in phase.release}
        for k, name in enumerate(phase.arm):
            if name in closed:
                reason = f"it is closed since the end of phase {closed[name]!r}; release it first"
                yield Fault(f"{name!r} cannot close: {reason}", ("phases", i, "arm", k))
        waiting = [name for name in phase.arm if name not in closed]
        bears_any_load = all(scenario.grasps[name].load_limit is None for name in waiting)
        if phase.until == "release" or not _asks_for_nothing(phase):
            closed = {}
        elif phase.until == "grasp" and phase.for_s is None and len(waiting) == 1 and bears_any_load:
            # One of the same two sites has taken over from another.
            sites = _sites(scenario, waiting[0])
            closed = {name: since for name, since in closed.items() if _sites(scenario, name) != sites}
            closed[waiting[0]] = phase.name


def _sites(scenario: ScenarioConfig, name: str) -> tuple[str, str]:
    """Sites that a grasp joins, without prefixes that may be left out."""
    config = scenario.grasps[name]
    return config.robot_site.rpartition("/")[2], config.object_site.rpartition("/")[2]


def _asks_for_nothing(phase: PhaseConfig) -> bool:
    """Whether the phase's control laws certainly request no grasp or release: built-in ones do not, others may."""
    classes = [kinds().classes.get(law.kind) for law in phase.laws.values()]
    return all(law is not None and law.__module__.partition(".")[0] == _OWN for law in classes)
