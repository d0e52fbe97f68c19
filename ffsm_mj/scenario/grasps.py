"""Static checks of grasps: names, arming and release by phases."""

from __future__ import annotations

from collections.abc import Iterator

from ffsm_controllers import kinds

from ffsm_mj.errors import Fault, unknown_name
from ffsm_mj.scenario.phase_config import PhaseConfig
from ffsm_mj.scenario.phase_graph import is_branching
from ffsm_mj.scenario.scenario import Scenario

_OWN = "ffsm_controllers"


def capture_faults(scenario: Scenario) -> list[Fault]:
    """Faults of grasps in phases: unknown grasps, and a grasp armed while another one is closed."""
    faults = []
    for i, phase in enumerate(scenario.phases):
        for key, names in (("arm", phase.arm), ("release", phase.release)):
            unknown = ((k, name) for k, name in enumerate(names) if name not in scenario.captures)
            faults += [Fault(unknown_name("capture", name, scenario.captures), ("phases", i, key, k)) for k, name in unknown]
    if is_branching(scenario.phases):
        return faults  # what was armed or closed before depends on the way that the run takes
    return faults or [*_second_grasps(scenario), *_ends_at_no_capture(scenario)]


def never_armed(scenario: Scenario) -> Iterator[str]:
    """Messages for grasps that no phase arms; a control law may still request them."""
    armed = {name for phase in scenario.phases for name in phase.arm}
    asking = [phase.name for phase in scenario.phases if not _asks_for_nothing(phase)]
    for name in scenario.captures:
        if name not in armed:
            law = f" unless the control law of phase {asking[0]!r} requests it" if asking else ""
            yield f"no phase arms the capture {name!r}, so it never closes{law}; write 'arm: [{name}]' in a phase"


def _ends_at_no_capture(scenario: Scenario) -> Iterator[Fault]:
    """Phases that wait for a capture that cannot occur: no grasp is armed, and no control law may request one."""
    for i, phase in enumerate(scenario.phases):
        if not _asks_for_nothing(phase):
            return
        if phase.until == "capture" and phase.for_s is None and not phase.arm and scenario.captures:
            message = f"no grasp is armed, so no capture ends this phase; write 'arm: [{next(iter(scenario.captures))}]'"
            yield Fault(message, ("phases", i, "until"))


def _second_grasps(scenario: Scenario) -> Iterator[Fault]:
    """Grasps that a phase arms while another one is certainly closed: it ended a phase and was not released since."""
    holding: tuple[tuple[str, ...], str] | None = None
    for i, phase in enumerate(scenario.phases):
        if holding is not None and set(phase.release) & set(holding[0]):
            holding = None
        for k, name in enumerate(phase.arm if holding is not None else ()):
            names, since = holding or ((), "")
            if any(other != name and _sites(scenario, other) == _sites(scenario, name) for other in names):
                continue  # it may take over
            message = f"{name!r} cannot close while {' or '.join(map(repr, names))} is closed"
            reason = f"since the end of phase {since!r}: one grasp can be closed at a time; release it first"
            yield Fault(f"{message}, {reason}, or give both the same sites, so that it takes over", ("phases", i, "arm", k))
            break
        bears_any_load = all(scenario.captures[name].load_limit is None for name in phase.arm)
        if phase.until == "capture" and phase.for_s is None and phase.arm and bears_any_load:
            holding = phase.arm, phase.name
        elif phase.until == "release" or not _asks_for_nothing(phase):
            holding = None


def _sites(scenario: Scenario, name: str) -> tuple[str, str]:
    """Sites that a grasp joins, without prefixes that may be left out."""
    config = scenario.captures[name]
    return config.robot_site.rpartition("/")[2], config.object_site.rpartition("/")[2]


def _asks_for_nothing(phase: PhaseConfig) -> bool:
    """Whether the phase's control laws certainly request no grasp or release: built-in ones do not, others may."""
    classes = [kinds().classes.get(law.kind) for law in phase.laws.values()]
    return all(law is not None and law.__module__.partition(".")[0] == _OWN for law in classes)
