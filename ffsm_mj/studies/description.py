"""Description of a study as text, for ``ffsm check``."""

from __future__ import annotations

from collections.abc import Mapping

from ffsm_mj.campaign.plan.description import description
from ffsm_mj.studies.plan import StudyPlan


def study_description(plan: StudyPlan) -> list[str]:
    """Lines that describe the variants of a study, then the campaign of the first one."""
    config = plan.config
    first, *_ = plan.variants.values()
    design = first.design()
    width = max(map(len, config.variants))
    lines = [
        f"{config.study}: valid",
        f"  {len(plan.variants)} variants of {len(design.rows)} runs each, with the same samples",
    ]
    for name, variant in config.variants.items():
        changes = [f"{key} = {_kind(value)}" for key, value in variant.overrides_after({}).items()]
        if variant.scenario is not None:
            changes.insert(0, f"scenario {variant.scenario}")
        lines.append(f"  {name:{width}}  {', '.join(changes) or 'as the scenario'}")
    lines += [f"not applicable: {name}: {reason}" for name, reason in plan.not_applicable.items()]
    for planned in plan.variants.values():
        if planned is not first:
            planned.design()  # refuses samples that the scenario of the variant does not accept
    if plan.own.metrics:
        lines.append(f"  own metrics: {', '.join(plan.own.metrics)}")
    return [*lines, f"variant {description(first, design)[0]}", *description(first, design)[1:]]


def _kind(value: object) -> str:
    """A value of an override; of a control law its kind."""
    return f"kind {value['kind']}" if isinstance(value, Mapping) and "kind" in value else flow(value)


def flow(value: object) -> str:
    """A value of a study file as YAML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(flow, value)) + "]"
    return str(value).lower() if isinstance(value, bool) or value is None else str(value)
