"""Ends of an episode: success, failure, forbidden contacts, and values beyond their bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from ffsm_mj.conditions import Condition, conditions
from ffsm_mj.contact_models.persistent.record import ContactEnds
from ffsm_mj.controller_protocol import Observation
from ffsm_mj.errors import Fault, ScenarioFaults
from ffsm_mj.gym.episode import Episode
from ffsm_mj.gym.values import Values
from ffsm_mj.scenario.env_config import EnvConfig

UNHANDLED = "unhandled"
"""Name for overlaps of geoms that no contact model handles, among the forbidden contacts."""
Overlaps = Callable[[], tuple[tuple[str, ...], ...]]
_Predicate = tuple[tuple[Condition, Callable[[Observation], Any]], ...]


class Ending(NamedTuple):
    """The end of an episode.

    Attributes:
        success: Whether it is one with success.
        reason: ``success``, ``failure``, ``forbidden contact PAIR``, ``bound of NAME``, or the outcome of the run.
    """

    success: bool
    reason: str


class Endings:
    """Ends of episodes of one run."""

    def __init__(self, config: EnvConfig, values: Values, episode: Episode, overlaps: Overlaps) -> None:
        """Bind the conditions to a run.

        Args:
            config: Section of the scenario.
            values: Values of the run.
            episode: Its metrics.
            overlaps: Geoms of the overlaps at the last control tick that no contact model handles.

        Raises:
            ScenarioFaults: One fault per unknown name.
        """
        self._faults: list[Fault] = []
        self._values, self._episode = values, episode
        self._overlaps: Overlaps = overlaps if UNHANDLED in config.forbidden_contacts else tuple
        self._success = self._predicate(config.success, "success")
        self._failure = self._predicate(config.failure, "failure")
        self._bounds = []
        for name, (low, high) in config.bounds.items():
            if read := self._bound(values.scalar, name, ("env", "bounds", name)):
                self._bounds.append((name, low, high, read))
        self._forbidden: set[str] = set()
        for i, name in enumerate(config.forbidden_contacts):
            if name == UNHANDLED:
                continue
            self._forbidden |= self._bound(values.pairs_of, [name], ("env", "forbidden_contacts", i)) or set()
        if self._faults:
            raise ScenarioFaults(self._faults)

    def _bound(self, bind: Callable[[Any], Any], name: Any, path: tuple[str | int, ...]) -> Any:
        """What a name is bound to; None with a fault."""
        try:
            return bind(name)
        except LookupError as error:
            self._faults.append(Fault(str(error.args[0]), path))
            return None

    def _predicate(self, text: str | None, key: str) -> _Predicate:
        if text is None:
            return ()
        found = [(each, self._bound(self._named, each.metric, ("env", key))) for each in conditions(text)]
        return tuple((each, read) for each, read in found if read is not None)

    def _named(self, name: str) -> Callable[[Observation], Any]:
        """Reader of a metric of the episode, or else of a value."""
        metric = self._episode.metric(name)
        return self._values.scalar(name) if metric is None else lambda _: metric()

    def reached(self, observation: Observation, events: Iterable[Any]) -> Ending | None:
        """End at a control tick, with the records since the last one; failure goes before success."""
        for record in events:
            if getattr(record, "pair", None) in self._forbidden and not isinstance(record, ContactEnds):
                return Ending(False, f"forbidden contact {record.pair}")
        for geoms in self._overlaps():
            return Ending(False, f"forbidden contact {' and '.join(geoms)}")
        for name, low, high, read in self._bounds:
            if not low <= read(observation) <= high:
                return Ending(False, f"bound of {name}")
        if _holds(self._failure, observation):
            return Ending(False, "failure")
        return Ending(True, "success") if _holds(self._success, observation) else None


def _holds(predicate: _Predicate, observation: Observation) -> bool:
    return bool(predicate) and all(each.holds({each.metric: read(observation)}) for each, read in predicate)
