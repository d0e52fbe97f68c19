"""Contact models that a scenario declares in addition to impacts, each validated by its own configuration model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pydantic import ValidationError, WithJsonSchema

from ffsm_mj.config import StrictModel
from ffsm_mj.contact_models.registry import contact_model_of, contact_models, record_kinds_of
from ffsm_mj.errors import Fault, ScenarioFaults, unknown_name
from ffsm_mj.scenario.faults import KindNames, plain_faults

REGIME_SCHEMA = WithJsonSchema({"type": "object", "required": ["kind"], "properties": {"kind": {"type": "string"}}})


def validated_contact_models(declared: tuple[Any, ...]) -> tuple[StrictModel, ...]:
    """Validated configurations of declared contact models.

    Raises:
        ScenarioFaults: An unknown kind, or an invalid configuration.
    """
    configs: list[StrictModel] = []
    faults: list[Fault] = []
    for i, given in enumerate(declared):
        try:
            configs.append(given if isinstance(given, StrictModel) else _checked(given))
        except ScenarioFaults as error:
            faults += [replace(fault, path=("contact_models", i, *fault.path)) for fault in error.faults]
    if faults:
        raise ScenarioFaults(faults)
    return tuple(configs)


def _checked(given: Any) -> StrictModel:
    if not isinstance(given, Mapping) or not isinstance(given.get("kind"), str):
        raise ScenarioFaults(
            [Fault(f"needs a 'kind'; allowed: {', '.join(sorted(contact_models())) or 'none is installed'}", ())]
        )
    try:
        config = contact_model_of(given["kind"]).Config
    except LookupError as error:
        raise ScenarioFaults([Fault(str(error.args[0]), ("kind",))]) from error
    try:
        return config.model_validate(given)
    except ValidationError as error:
        raise ScenarioFaults(plain_faults(error, KindNames(config, (), (), {}))) from error


def endings(configs: tuple[Any, ...], *, grasps: bool) -> tuple[str, ...]:
    """Events that may end a phase: of contacts and joint limits, grasps, releases, records of contact models."""
    named = (kind.name for config in configs for kind in record_kinds_of(config.kind))
    contacts = ("impact", "contact_begins", "contact_ends", "contact_slips", "contact_sticks")
    return (*contacts, "limit_impact", "limit_begins", "limit_ends", *(("grasp", "release") if grasps else ()), *named)


def fault_of_ending(until: str | None, configs: tuple[Any, ...], *, grasps: bool) -> str:
    """What is wrong with a phase's ``until``; empty if it is valid."""
    allowed = (*endings(configs, grasps=grasps), "settled", "finished", "end")
    return "" if until is None or until in allowed else unknown_name("end of a phase", until, allowed)
