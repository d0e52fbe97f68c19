"""Features as data, and made again from them: those of closed contacts are of the state of a simulation.

A feature keeps what it was made of (:attr:`~.gap_function.GapFunction.made_of`): names, signs and cores. Cores that share a
body object belong to one search, and only these are on one face; so bodies are told by their ids and their places in a list.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from ffsm_mj.contact.features.body_motion import Body
from ffsm_mj.contact.features.cores import Circle, Ellipsoid, Face, Line, Point
from ffsm_mj.contact.features.gap_function import Feature, GapFunction
from ffsm_mj.contact.features.point_line_gaps import LineOnCurve, PointOnCurve, PointOnFace, PointOnPoint
from ffsm_mj.contact.features.rim_gaps import RimOnEllipsoid, RimOnRim, SideOnRim
from ffsm_mj.contact.features.round_gaps import EllipsoidOnEllipsoid, OnEllipsoid, RoundOnFace
from ffsm_mj.state import StateError

_GAPS = (PointOnFace, PointOnPoint, PointOnCurve, LineOnCurve, RimOnRim, SideOnRim, RimOnEllipsoid)
_KINDS = {each.__name__: each for each in (*_GAPS, RoundOnFace, OnEllipsoid, EllipsoidOnEllipsoid)}
_CORES = {each.__name__: each for each in (Point, Line, Face, Circle, Ellipsoid)}


class StoredFeatures:
    """Writes the features of one state, or makes those of one state."""

    def __init__(self, model: Any) -> None:
        """Start without bodies.

        Args:
            model: MuJoCo model that has them.
        """
        self._model = model
        self._bodies: dict[int, Body] = {}

    def told(self, feature: Feature) -> dict[str, Any]:
        """A feature as data: its kind, what it is made of, and what it remembers."""
        assert isinstance(feature, GapFunction)
        made_of = [self._as_data(each) for each in feature.made_of]
        return {"kind": type(feature).__name__, "made_of": made_of, "state": feature.get_state()}

    def made(self, told: Any) -> GapFunction:
        """A feature from data.

        Raises:
            StateError: They are none.
        """
        try:
            feature: GapFunction = _KINDS[told["kind"]](*(self._from_data(each) for each in told["made_of"]))
            feature.set_state(told["state"])
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise StateError(f"a contact feature in a state cannot be made: {error!r}") from error
        return feature

    def _as_data(self, part: Any) -> Any:
        if isinstance(part, Body):
            number = next((number for number, body in self._bodies.items() if body is part), len(self._bodies))
            self._bodies[number] = part
            return {"body": part.id, "number": number}
        if type(part).__name__ in _CORES:
            named = {each.name: self._as_data(getattr(part, each.name)) for each in fields(part)}
            return {"core": type(part).__name__, "of": named}
        return tuple(map(self._as_data, part)) if isinstance(part, tuple) else part

    def _from_data(self, told: Any) -> Any:
        if isinstance(told, tuple):
            return tuple(map(self._from_data, told))
        if not isinstance(told, Mapping):
            return told
        if "core" in told:
            return _CORES[told["core"]](**{name: self._from_data(each) for name, each in told["of"].items()})
        body, number = told["body"], told["number"]
        if not 0 <= body < self._model.nbody:
            raise ValueError(f"no body {body}")
        made = self._bodies.setdefault(number, Body(self._model, body))
        if made.id != body:
            raise ValueError(f"body {body} is {made.id} elsewhere")
        return made
