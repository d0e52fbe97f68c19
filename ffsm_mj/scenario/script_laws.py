"""Control laws and estimators that a script passes to a run: classes by kind, without a package."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal, TypeVar, Union

from pydantic import Field, create_model

from ffsm_mj.config import PartName, StrictModel
from ffsm_mj.errors import InputError

Model = TypeVar("Model", bound=StrictModel)
Phase = TypeVar("Phase", bound=StrictModel)
_METHODS = {"controllers": ("start", "control", "telemetry"), "estimators": ("start", "update", "telemetry")}


class NoSettings(StrictModel):
    """Configuration of a control law or estimator without a ``Config``."""

    kind: str


def refuse_script_classes(option: str, classes: Mapping[str, Any], installed: Collection[str]) -> None:
    """Refuse classes that are not control laws, or not estimators.

    Args:
        option: How they are passed, ``controllers`` or ``estimators``.
        classes: Classes by kind.
        installed: Installed kinds.

    Raises:
        InputError: One line per fault.
    """
    if not isinstance(classes, Mapping):
        raise InputError(f"{option}: must be a mapping of classes by kind, and is {type(classes).__name__}")
    lines, methods = [], _METHODS[option]
    for kind, law in classes.items():
        missing = [name for name in methods if not callable(getattr(law, name, None))]
        config = getattr(law, "Config", NoSettings)
        if kind in installed:
            lines.append(f"{option}: {kind!r} is the name of an existing kind; choose another name")
        elif not isinstance(law, type) or missing:
            lines.append(f"{option}: {kind!r} is no class with the methods {', '.join(methods)}")
        elif not isinstance(getattr(law, "telemetry_signals", None), tuple | list | property):
            lines.append(f"{option}: {kind!r} has no telemetry_signals; () reports nothing")
        elif not (isinstance(config, type) and issubclass(config, StrictModel)):
            lines.append(f"{option}: the Config of {kind!r} is no ffsm_mj.controller_protocol.StrictModel")
        elif config is not NoSettings and _kind_of(config) != kind:
            lines.append(f"{option}: the Config of {kind!r} needs the field kind: Literal[{kind!r}]")
    if lines:
        raise InputError(lines)


def _kind_of(config: type[StrictModel]) -> str | None:
    field = config.model_fields.get("kind")
    values: tuple[Any, ...] = getattr(field.annotation, "__args__", ()) if field is not None else ()
    return str(values[0]) if len(values) == 1 else None


def config_of(law: Any, kind: str) -> type[StrictModel]:
    """Configuration model of a law."""
    if hasattr(law, "Config"):
        return law.Config  # type: ignore[no-any-return]
    only: Any = Literal[kind]
    return create_model(f"{law.__name__}Config", __base__=NoSettings, kind=(only, ...))


def model_with(
    scenario: type[Model], phase: type[StrictModel], laws: tuple[Any, ...], estimators: tuple[Any, ...]
) -> type[Model]:
    """Scenario model that accepts control laws and estimators with these configurations."""
    choice: Any = _choice(laws)
    estimator: Any = _choice(estimators)
    several: Any = dict[PartName, choice]
    some_parts: Any = Annotated[several, Field(min_length=1)] | None
    phases: Any = create_model(
        phase.__name__, __base__=phase, controller=(choice | None, None), controllers=(some_parts, None)
    )
    some: Any = Annotated[tuple[phases, ...], Field(min_length=1)]
    default = scenario.model_fields["estimator"].default
    return create_model(scenario.__name__, __base__=scenario, phases=(some, ...), estimator=(estimator, default))


def _choice(configs: tuple[Any, ...]) -> Any:
    union: Any = Union.__getitem__(configs)
    return Annotated[union, Field(discriminator="kind")]


def importable(config: Any, classes: Mapping[str, Any]) -> Any:
    """A configuration as an instance of an importable class: one that a class of a script leaves out has its kind only."""
    settled = config is None or config.kind not in classes or hasattr(classes[config.kind], "Config")
    return config if settled else NoSettings(kind=config.kind)


def as_phases(given: tuple[Any, ...], phase: type[Phase], laws: Mapping[str, Any]) -> tuple[Phase, ...]:
    """The phases as instances of an importable class, so that they can be pickled."""
    found = []
    for each in given:
        parts = each.controllers and {name: importable(config, laws) for name, config in each.controllers.items()}
        found.append(
            phase.model_construct(**dict(each) | {"controller": importable(each.controller, laws), "controllers": parts})
        )
    return tuple(found)
