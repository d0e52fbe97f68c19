"""Settings of a campaign: all that its rows depend on, besides the index of the run."""

from __future__ import annotations

import hashlib
import inspect
import json
from importlib.metadata import entry_points
from typing import Any

from ffsm_controllers import GROUP as LAWS
from ffsm_controllers.estimators import GROUP as ESTIMATORS
from ffsm_mj.analysis.comparison import changed_leaves
from ffsm_mj.assembly.run import versions
from ffsm_mj.contact_models.impact.law import GROUP as IMPACT_LAWS
from ffsm_mj.contact_models.registry import GROUP as CONTACT_MODELS
from ffsm_mj.experiments.metrics import COUNT, FileMetric
from ffsm_mj.experiments.metrics import GROUP as PLUGIN_METRICS
from ffsm_mj.experiments.planning import Plan
from ffsm_mj.yaml import YamlFault, plain_value

_MOST_CHANGES, _LONGEST_VALUE = 3, 60
"""Changes of settings that a message names, and characters of a value: it stays one line that can be read."""


def row_versions() -> dict[str, str]:
    """Versions of all packages that affect rows: the libraries and plug-in packages."""
    all_versions = dict(versions())
    for group in (LAWS, ESTIMATORS, PLUGIN_METRICS, IMPACT_LAWS, CONTACT_MODELS):
        for point in entry_points(group=group):
            if point.dist is not None:
                all_versions[point.dist.name] = point.dist.version
    return all_versions


def campaign_settings(plan: Plan) -> str:
    """Settings of a campaign as JSON text with sorted keys."""
    config, classes = plan.config, plan.classes
    sampling = {
        "samples": config.samples.model_dump(mode="json", exclude={"n"}),
        "dispersions": config.model_dump(mode="json", exclude_none=True)["dispersions"],
    }
    # Campaigns with the default have the same settings as before the key existed.
    counted = {} if config.truncated == COUNT else {"truncated": config.truncated}
    content = {
        "scenario": plan.base.scenario_yaml,
        "models": {name: hashlib.sha256(data).hexdigest() for name, data in sorted(plan.base.logged_files.items())},
        "sampling": sampling | counted,
        "metrics": list(config.all_metrics),
        "controllers": {kind: source_of(law) for kind, law in classes.controllers.items()},
        "versions": row_versions(),
    }
    if classes.estimators:  # campaigns without have the same settings as before there were any
        content["estimators"] = {kind: source_of(estimator) for kind, estimator in classes.estimators.items()}
    if classes.metrics:  # likewise; lines by number, so that the first that changed are named
        lines = {name: source_of(metric).splitlines() for name, metric in classes.metrics.items()}
        content["metric functions"] = {name: dict(enumerate(text)) for name, text in lines.items()}
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


def settings_changes(stored: str, now: str) -> str:
    """Changes of settings as text; the stored settings may be damaged."""
    try:
        before, after = (_with_parsed_scenario(json.loads(text)) for text in (stored, now))
        changes = [f"{key} {_short(old)} there, {_short(new)} here" for key, old, new in changed_leaves(before, after)]
    except (ValueError, TypeError, KeyError, RecursionError, YamlFault):
        return "the stored settings cannot be read"
    more = f"; and {len(changes) - _MOST_CHANGES} more" if len(changes) > _MOST_CHANGES else ""
    return "; ".join(changes[:_MOST_CHANGES]) + more


def _with_parsed_scenario(settings: dict[str, Any]) -> dict[str, Any]:
    return settings | {"scenario": plain_value(settings["scenario"])}


def _short(value: Any) -> str:
    text = repr(value) if value is not None else "nothing"
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."
