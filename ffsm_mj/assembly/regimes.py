"""The contact regimes of a run: the impact first, what lasts after it, then those that the scenario declares."""

from __future__ import annotations

from ffsm_mj.capture.record import KINDS
from ffsm_mj.contact.pairs import ContactPair
from ffsm_mj.contact.regimes import Regime, Scene, regime_of
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.impact.regime import ImpactRules, Impacts
from ffsm_mj.impact.resting import RestRule
from ffsm_mj.lasting.regime import Lasting
from ffsm_mj.scenario.scenario import Scenario


def impacts_of(scenario: Scenario, scene: Scene, pairs: tuple[ContactPair, ...]) -> tuple[Impacts, Lasting]:
    """The impact regime of a scenario, and what holds the pairs that it leaves closed."""
    interval = scenario.impact.rest_interval_s
    rules = ImpactRules(
        law=scenario.impact.law,
        rest=RestRule(scenario.time_step_s if interval is None else interval, scenario.impact.rest_speed_m_s),
        max_impacts=scenario.impact.max_impacts,
        stop_on_impact=scenario.stop_on_impact,
    )
    impacts = Impacts(scene, pairs, rules)
    return impacts, Lasting(scene, impacts)


def declared_regimes(scenario: Scenario, scene: Scene) -> tuple[Regime, ...]:
    """The regimes that a scenario declares, in its order.

    Raises:
        ScenarioFaults: One cannot be made of what is declared: a geom that there is not.
    """
    made: list[Regime] = []
    faults: list[Fault] = []
    for i, config in enumerate(scenario.regimes):
        try:
            made.append(regime_of(config.kind)(config, scene))
        except ScenarioFaults as error:
            faults += [Fault(fault.message, ("regimes", i, *fault.path)) for fault in error.faults]
        except LookupError as error:
            faults.append(Fault(str(error.args[0]), ("regimes", i)))
    if faults:
        raise ScenarioFaults(faults)
    return tuple(made)


def record_kinds(scenario: Scenario) -> tuple[str, ...]:
    """Names of the kinds of record that captures and the declared regimes may leave."""
    kinds = [
        *(KINDS if scenario.captures else ()),
        *(kind for each in scenario.regimes for kind in regime_of(each.kind).records),
    ]
    return tuple(dict.fromkeys(kind.name for kind in kinds))
