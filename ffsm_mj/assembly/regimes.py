"""The contact regimes of a run."""

from __future__ import annotations

from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.regimes import Scene
from ffsm_mj.impact.regime import ImpactRules, Impacts
from ffsm_mj.impact.resting import RestRule
from ffsm_mj.scenario.scenario import Scenario


def impacts_of(scenario: Scenario, scene: Scene, pairs: tuple[ContactPair, ...]) -> Impacts:
    """The impact regime of a scenario."""
    interval = scenario.impact.rest_interval_s
    rules = ImpactRules(
        law=scenario.impact.law,
        rest=RestRule(scenario.time_step_s if interval is None else interval, scenario.impact.rest_speed_m_s),
        max_impacts=scenario.impact.max_impacts,
        stop_on_impact=scenario.stop_on_impact,
    )
    return Impacts(scene, pairs, rules)
