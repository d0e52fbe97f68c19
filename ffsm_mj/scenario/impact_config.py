"""Impacts in a scenario: pairs, ignored pairs, and the impact law."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field, PositiveInt, model_validator

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.scenario.element_names import element_name
from ffsm_mj.scenario.impact_law import LawName


class ImpactPairConfig(StrictModel):
    """Two geoms whose contact is resolved, on bodies in relative motion: ``geoms``, or robot_geom and object_geom."""

    model_config = ConfigDict(
        json_schema_extra={"oneOf": [{"required": ["geoms"]}, {"required": ["robot_geom", "object_geom"]}]}
    )

    geoms: Annotated[tuple[Name, ...], Field(min_length=2, max_length=2)] | None = None
    """Geoms a and b, of the robot or of objects, both may be of the same one; at most one is fixed. Normal from a to b."""
    robot_geom: Name | None = None
    """Geom a, of the robot, if geom b is of an object; replaces ``geoms``."""
    object_geom: Name | None = None
    """Geom b, of an object; with ``robot_geom``."""
    name: Name = Field(default_factory=lambda fields: element_name(fields) or "")
    """Unique name in records, columns and overrides; default: ``<a>-<b>``, the geoms as written here."""
    restitution: Annotated[float, Field(ge=0.0)] = 1.0
    """Coefficient of restitution e: 1 elastic, 0 plastic."""
    mu: Annotated[float, Field(ge=0.0)] = 0.0
    """Coefficient of Coulomb friction at impacts; that of the MJCF is for MuJoCo's own contacts and is not used."""
    super_elastic: bool = False
    """Allow e > 1, an impact that gains energy (case c of the paper)."""

    @property
    def sides(self) -> tuple[str, str]:
        """Geoms a and b as the scenario names them."""
        return (self.geoms[0], self.geoms[1]) if self.geoms else (self.robot_geom or "", self.object_geom or "")

    @model_validator(mode="after")
    def _one_way_to_name_two_geoms(self) -> ImpactPairConfig:
        given = [key for key in ("geoms", "robot_geom", "object_geom") if getattr(self, key) is not None]
        if given not in (["geoms"], ["robot_geom", "object_geom"]):
            raise ValueError("a pair needs 'geoms: [a, b]', or 'robot_geom' and 'object_geom'")
        if self.name.isdecimal():
            raise ValueError(f"the name {self.name!r} would be ambiguous with a position in the list; add a letter")
        return self

    @model_validator(mode="after")
    def _super_elastic_by_name(self) -> ImpactPairConfig:
        if self.restitution > 1.0 and not self.super_elastic:
            raise ValueError("restitution must be in [0, 1]; above 1 only with 'super_elastic: true'")
        if self.restitution > 1.0 and self.mu > 0.0:
            raise ValueError("an impact that gains energy (restitution above 1) has no law with friction; set mu to 0")
        return self


class IgnoredPairConfig(StrictModel):
    """A pair of geoms, bodies or models whose contacts are ignored."""

    pair: Annotated[tuple[Name, ...], Field(min_length=2, max_length=2)]
    """Two names, each a geom, a body (all its geoms), or a model: ``robot`` or the name of an object."""
    reason: Name
    """Why these contacts can be ignored."""


class ImpactConfig(StrictModel):
    """Impact law, and limits of impact resolution."""

    law: LawName = "blend"
    """An installed impact law; the built-in ones differ where several contacts meet at once. No ``newton`` with mu."""
    rest_interval_s: Annotated[float, Field(ge=0.0)] | None = None
    """A contact with e < 1 becomes persistent when its next bounce would be shorter, s; default: time_step_s."""
    rest_speed_m_s: Annotated[float, Field(ge=0.0)] = 0.0
    """A pressed contact with e < 1 becomes persistent if it would separate more slowly than this, m/s."""
    max_impacts: PositiveInt = 10_000
    """The run ends after this many impacts, those at joint limits included."""
