"""Settings that determine the rows of a campaign, and their hash: a table holds rows of one hash only."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points
from typing import Any

from ffsm_controllers import GROUP as LAWS
from ffsm_controllers.estimators import GROUP as ESTIMATORS
from ffsm_mj.assembly.recording import versions
from ffsm_mj.campaign.execution.file_metrics import FileMetric
from ffsm_mj.campaign.execution.metrics import COUNT
from ffsm_mj.campaign.execution.metrics import GROUP as METRICS
from ffsm_mj.campaign.plan.loading import Plan
from ffsm_mj.campaign.script_classes import ScriptClasses
from ffsm_mj.contact_models.impact.installed_laws import GROUP as IMPACT_LAWS
from ffsm_mj.contact_models.registry import GROUP as CONTACT_MODELS
from ffsm_mj.yaml.parser import YamlFault, plain_value

_MOST_DIFFERENCES = 3


def row_versions() -> dict[str, str]:
    """Versions of all packages that affect rows: the libraries and plug-in packages."""
    found = dict(versions())
    for group in (LAWS, ESTIMATORS, METRICS, IMPACT_LAWS, CONTACT_MODELS):
        for point in entry_points(group=group):
            if point.dist is not None:
                found[point.dist.name] = point.dist.version
    return found


def campaign_settings(plan: Plan, own: ScriptClasses) -> str:
    """Settings of a campaign as JSON text.

    Args:
        plan: Campaign file and base scenario.
        own: Control laws, estimators and metrics of a script.
    """
    config = plan.config
    sampling = {
        "samples": config.samples.model_dump(mode="json", exclude={"n"}),
        "dispersions": config.model_dump(mode="json", exclude_none=True)["dispersions"],
    }
    # Campaigns with the default have the same settings as before the key existed.
    counted = {} if config.truncated == COUNT else {"truncated": config.truncated}
    files = plan.base.logged_files
    return settings_of(plan.base.scenario_yaml, files, sampling | counted, config.kept_metrics, own)


def settings_of(
    scenario_yaml: str,
    files: Mapping[str, bytes],
    sampling: Mapping[str, Any],
    metrics: Sequence[str],
    own: ScriptClasses,
) -> str:
    """Settings as JSON text with sorted keys.

    Args:
        scenario_yaml: Resolved base scenario.
        files: Model files by name.
        sampling: Sampling and dispersions, without the number of samples.
        metrics: Names of the metrics.
        own: Control laws, estimators and metrics of a script.
    """
    content = {
        "scenario": scenario_yaml,
        "models": {name: hashlib.sha256(data).hexdigest() for name, data in sorted(files.items())},
        "sampling": dict(sampling),
        "metrics": list(metrics),
        "controllers": {kind: source_of(law) for kind, law in own.controllers.items()},
        "versions": row_versions(),
    }
    if own.estimators:  # campaigns without have the same settings as before there were any
        content["estimators"] = {kind: source_of(each) for kind, each in own.estimators.items()}
    if own.metrics:  # likewise; lines, so that differences name the first that changed
        content["metric functions"] = {name: source_of(each).splitlines() for name, each in own.metrics.items()}
    return json.dumps(content, sort_keys=True, indent=1)


def source_of(law: Any) -> str:
    """Source code of a class or function; its full name if there is no source."""
    if isinstance(law, FileMetric):
        return law.text
    try:
        return inspect.getsource(law)
    except (OSError, TypeError):
        return f"{law.__module__}.{getattr(law, '__qualname__', type(law).__qualname__)}"


def settings_hash(settings: str) -> str:
    """SHA-256 of the settings."""
    return hashlib.sha256(settings.encode()).hexdigest()


def differences(stored: str, now: str) -> str:
    """Differences between two settings as text; the stored settings may be damaged."""
    try:
        a, b = (_leaves(_with_parsed_scenario(json.loads(text))) for text in (stored, now))
    except (ValueError, TypeError, KeyError, RecursionError, YamlFault):
        return "the stored settings cannot be read"
    found = [
        f"{key} {_short(a.get(key))} there, {_short(b.get(key))} here"
        for key in sorted({*a, *b})
        if a.get(key) != b.get(key)
    ]
    more = f"; and {len(found) - _MOST_DIFFERENCES} more" if len(found) > _MOST_DIFFERENCES else ""
    return "; ".join(found[:_MOST_DIFFERENCES]) + more


def _with_parsed_scenario(settings: dict[str, Any]) -> dict[str, Any]:
    return settings | {"scenario": plain_value(settings["scenario"])}


def _leaves(value: Any, key: str = "") -> dict[str, Any]:
    """Scalars of nested data by dotted key."""
    if isinstance(value, Mapping) and value:
        pairs = value.items()
    elif isinstance(value, list) and value:
        pairs = dict(enumerate(value)).items()
    else:
        return {key: value}
    return {name: leaf for part, item in pairs for name, leaf in _leaves(item, f"{key}.{part}".lstrip(".")).items()}


def _short(value: Any) -> str:
    text = repr(value) if value is not None else "nothing"
    return text if len(text) <= 60 else f"{text[:60]}..."
