"""What the rows of a campaign depend on, and its hash: rows of one hash may stand in one table."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Mapping, Sequence
from importlib.metadata import entry_points, version
from typing import Any

from ffsm_controllers import GROUP as LAWS

from ffsm_mj.assembly.run import versions
from ffsm_mj.campaign.execution.metrics import GROUP as METRICS
from ffsm_mj.compiled import is_compiled
from ffsm_mj.contact_models.impact.installed_laws import GROUP as IMPACT_LAWS
from ffsm_mj.contact_models.interface import GROUP as CONTACT_MODELS
from ffsm_mj.yaml.parser import YamlFault, plain_value

_LEAST_DIFFERENCES = 3


def row_versions() -> dict[str, str]:
    """Versions of all that shapes a row: our packages, the compiled twins or their absence, and plug-in packages."""
    found = versions() | {"ffsm-mj-fast": version("ffsm-mj-fast") if is_compiled() else "none"}
    for group in (LAWS, METRICS, IMPACT_LAWS, CONTACT_MODELS):
        for point in entry_points(group=group):
            if point.dist is not None:
                found[point.dist.name] = point.dist.version
    return found


def settings_of(
    scenario_yaml: str,
    files: Mapping[str, bytes],
    sampling: Mapping[str, Any],
    metrics: Sequence[str],
    laws: Mapping[str, Any],
) -> str:
    """The settings as JSON text with sorted keys.

    Args:
        scenario_yaml: The base scenario with every default written out.
        files: Its models by name.
        sampling: How runs are drawn, without how many.
        metrics: What is measured.
        laws: Control laws of a script, classes by kind.
    """
    content = {
        "scenario": scenario_yaml,
        "models": {name: hashlib.sha256(data).hexdigest() for name, data in sorted(files.items())},
        "sampling": dict(sampling),
        "metrics": list(metrics),
        "controllers": {kind: source_of(law) for kind, law in laws.items()},
        "versions": row_versions(),
    }
    return json.dumps(content, sort_keys=True, indent=1)


def source_of(law: Any) -> str:
    """Source of a class, by which it is known; its full name where there is none to read."""
    try:
        return inspect.getsource(law)
    except (OSError, TypeError):
        return f"{law.__module__}.{law.__qualname__}"


def settings_hash(settings: str) -> str:
    """SHA-256 of the settings."""
    return hashlib.sha256(settings.encode()).hexdigest()


def differences(stored: str, now: str) -> str:
    """What differs between two settings, for a person; somebody else may have written the stored ones."""
    try:
        a, b = (_leaves(_with_scenario_as_data(json.loads(text))) for text in (stored, now))
    except (ValueError, TypeError, KeyError, RecursionError, YamlFault):
        return "those there cannot be read"
    found = [
        f"{key} {_short(a.get(key))} there, {_short(b.get(key))} here"
        for key in sorted({*a, *b})
        if a.get(key) != b.get(key)
    ]
    more = f"; and {len(found) - _LEAST_DIFFERENCES} more" if len(found) > _LEAST_DIFFERENCES else ""
    return "; ".join(found[:_LEAST_DIFFERENCES]) + more


def _with_scenario_as_data(settings: dict[str, Any]) -> dict[str, Any]:
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
