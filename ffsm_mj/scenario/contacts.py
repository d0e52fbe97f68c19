"""Contacts of a scenario: which geoms may touch, with which restitution and friction."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from ffsm_mj.config import Name, StrictModel
from ffsm_mj.scenario.source import element_name

Sides = Annotated[tuple[Name, ...], Field(min_length=2, max_length=2)]


def _one_coefficient(mu: Any) -> Any:
    """Refuse the list of coefficients that MuJoCo has for a geom."""
    if isinstance(mu, list | tuple):
        raise ValueError("should be one number: contact points have no torsional or rolling friction")
    return mu


Mu = Annotated[float, Field(ge=0.0), BeforeValidator(_one_coefficient)]

PoissonRatio = Annotated[float, Field(ge=0.0, le=0.5)]
Modulus = Annotated[float, Field(gt=0.0)]


class ElasticConfig(StrictModel):
    """Elastic constants of the surfaces of a contact, for the impact law ``compliant``: how stiff it is across its normal.

    The ratio of stiffnesses is that of Mindlin and Hertz, k_t / k_n = 4 G* / E* with 1 / G* = sum (2 - nu) / G and
    1 / E* = sum (1 - nu^2) / E over the sides, G = E / (2 (1 + nu)): of one material it is 2 (1 - nu) / (2 - nu).
    """

    poisson_ratio: PoissonRatio | Annotated[tuple[PoissonRatio, ...], Field(min_length=2, max_length=2)]
    """Poisson's ratio of both sides, or of each in the order of ``between``."""
    young_modulus_Pa: Annotated[tuple[Modulus, ...], Field(min_length=2, max_length=2)] | None = None
    """Young's modulus of each side in the order of ``between``, Pa; only their ratio counts. Sides with the same Poisson's
    ratio need none."""

    @model_validator(mode="after")
    def _determines_the_ratio(self) -> ElasticConfig:
        ratios = self.poisson_ratio
        if isinstance(ratios, tuple) and ratios[0] != ratios[1] and self.young_modulus_Pa is None:
            raise ValueError("two different Poisson's ratios need 'young_modulus_Pa' of both sides too")
        return self

    @property
    def compliance_ratio(self) -> float:
        """Tangential over normal compliance, k_n / k_t = E* / (4 G*), from 1 to 1.5."""
        ratios = self.poisson_ratio if isinstance(self.poisson_ratio, tuple) else 2 * (self.poisson_ratio,)
        sides = tuple(zip(ratios, self.young_modulus_Pa or (1.0, 1.0), strict=True))
        across = sum((2.0 - nu) * (1.0 + nu) / modulus for nu, modulus in sides)
        return 0.5 * across / sum((1.0 - nu * nu) / modulus for nu, modulus in sides)


_REFUSED_FRICTION = {
    "static": "mu is the coefficient of friction of points that stick and of points that slide",
    "kinetic": "mu is the coefficient of friction of points that stick and of points that slide",
    "dynamic": "mu is the coefficient of friction of points that stick and of points that slide",
    "torsion": "a contact point has no torsional friction; a face resists torsion by its points, with the coefficient mu",
    "spin": "a contact point has no torsional friction; a face resists torsion by its points, with the coefficient mu",
    "roll": "a contact point has no rolling friction; the coefficient of friction is mu",
    "friction": "the coefficient of friction is mu",
}
"""What is said of keys that contain a word."""


class ContactDefaultConfig(StrictModel):
    """Restitution, friction and elastic constants of the contacts whose rule states none."""

    refused_keys: ClassVar = _REFUSED_FRICTION

    restitution: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    """Coefficient of restitution e: 1 elastic, 0 plastic."""
    mu: Mu = 0.0
    """Coefficient of Coulomb friction; that of the MJCF is for MuJoCo's own contacts and is not used."""
    elastic: ElasticConfig | None = None
    """Elastic constants, which ``impact.law: compliant`` needs of each pair with friction."""


class ContactRuleConfig(StrictModel):
    """A rule: contacts between two sides are resolved. Where rules overlap, the last one that names a pair has it."""

    # In a file with ``extends``, a rule that names one of the parent's may leave its sides out.
    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["between"]}]})
    refused_keys: ClassVar = _REFUSED_FRICTION

    between: Sides
    """Two sides, each the robot or an object by its name, a body, a subtree (``robot/hand/*``: a body and all that it
    carries), a geom, or ``"*"`` for all of another model; ``[robot, self]``: contacts of the robot with itself."""
    name: Name = Field(default_factory=lambda fields: element_name(fields) or "")
    """Unique name in records, columns and overrides; default: ``<a>-<b>``, the sides as written here."""
    restitution: Annotated[float, Field(ge=0.0)] | None = None
    """Coefficient of restitution e: 1 elastic, 0 plastic; default: that of ``contacts.default``."""
    mu: Mu | None = None
    """Coefficient of Coulomb friction, at impacts and in persistent contact, of points that stick or slide; default: that of
    ``contacts.default``."""
    elastic: ElasticConfig | None = None
    """Elastic constants, for ``impact.law: compliant``; default: those of ``contacts.default``."""
    super_elastic: bool = False
    """Allow e > 1, an impact that gains energy (case c of the paper)."""

    @model_validator(mode="after")
    def _has_a_usable_name(self) -> ContactRuleConfig:
        if self.name.isdecimal():
            raise ValueError(f"the name {self.name!r} would be ambiguous with a position in the list; add a letter")
        return self

    @model_validator(mode="after")
    def _super_elastic_by_name(self) -> ContactRuleConfig:
        if (self.restitution or 0.0) > 1.0 and not self.super_elastic:
            raise ValueError("restitution must be in [0, 1]; above 1 only with 'super_elastic: true'")
        if (self.restitution or 0.0) > 1.0 and (self.mu or 0.0) > 0.0:
            raise ValueError("an impact that gains energy (restitution above 1) has no law with friction; set mu to 0")
        return self


class IgnoredContactConfig(StrictModel):
    """Contacts that are neither resolved nor reported."""

    between: Sides
    """Two sides, as in a rule; a model with itself: ``[robot, self]``."""
    reason: Name
    """Why these contacts can be ignored."""


class ContactsConfig(StrictModel):
    """Which geoms may touch. Without rules: all geoms of different models that can collide by MuJoCo's own filters."""

    default: ContactDefaultConfig = ContactDefaultConfig()
    """Restitution and friction where a rule states none."""
    rules: tuple[ContactRuleConfig, ...] | None = None
    """Contacts that are resolved; all other overlaps are reported. Default: a rule for each pair of models; ``[]``: none."""
    ignored: tuple[IgnoredContactConfig, ...] = ()
    """Contacts that are neither resolved nor reported; they are taken out of every rule."""
    weld_m: Annotated[float, Field(ge=0.0)] = 1e-9
    """Faces of pieces of one rigid body that are coplanar within this are one face, m: their corners are moved onto it."""

    @field_validator("rules")
    @classmethod
    def _with_defaults(
        cls, rules: tuple[ContactRuleConfig, ...] | None, info: ValidationInfo
    ) -> tuple[ContactRuleConfig, ...] | None:
        """Rules with the default of what they do not state: dispersions and resolved scenarios have numbers."""
        default = info.data.get("default")
        if rules is None or default is None:
            return rules
        unstated = [{key for key in ("restitution", "mu", "elastic") if getattr(rule, key) is None} for rule in rules]
        return tuple(
            rule.model_copy(update={key: getattr(default, key) for key in keys})
            for rule, keys in zip(rules, unstated, strict=True)
        )

    def restitution_of(self, rule: ContactRuleConfig) -> float:
        """Coefficient of restitution of a rule."""
        return self.default.restitution if rule.restitution is None else rule.restitution

    def mu_of(self, rule: ContactRuleConfig) -> float:
        """Coefficient of friction of a rule."""
        return self.default.mu if rule.mu is None else rule.mu

    def elastic_of(self, rule: ContactRuleConfig) -> ElasticConfig | None:
        """Elastic constants of a rule; None if they are not stated."""
        return self.default.elastic if rule.elastic is None else rule.elastic
