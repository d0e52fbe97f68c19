"""Validation of the metrics that a campaign file names."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType

from ffsm_mj.campaign.execution.metrics import fault_of
from ffsm_mj.campaign.plan.config import CampaignFile
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.model.system import System
from ffsm_mj.records.signals import identifier
from ffsm_mj.yaml.node import KeyPath


def refuse_metrics(
    config: CampaignFile,
    system: System,
    own: Iterable[str] = (),
    places: Mapping[str, KeyPath] = MappingProxyType({}),
) -> None:
    """Refuse names that are not metrics.

    Args:
        config: The campaign.
        system: Robot and objects.
        own: Names of the caller's own metrics.
        places: Where metrics stand in the file, by name; those that are not listed stand in ``metrics``.

    Raises:
        ScenarioFaults: One fault per name.
    """
    actuators = [identifier(name) for name in system.names("actuator")]
    faults = [
        Fault(fault, path) for name, path in _named(config, places) if (fault := fault_of(name, actuators, own)) is not None
    ]
    if config.stop is not None and config.stop.metric == "success" and config.success is None:
        faults.append(Fault("the campaign has no success condition: set 'success', or name a metric", ("stop", "metric")))
    if faults:
        raise ScenarioFaults(faults)


def _named(config: CampaignFile, places: Mapping[str, KeyPath]) -> Iterator[tuple[str, KeyPath]]:
    """Metrics, each with its location in the campaign file."""
    for i, name in enumerate(config.metrics):
        yield name, places.get(name, ("metrics", i))
    for condition in config.conditions:
        yield condition.metric, ("success",)
    for name in config.keep.worst:
        yield name, ("keep", "worst", name)
    if config.stop is not None and config.stop.metric != "success":
        yield config.stop.metric, ("stop", "metric")
