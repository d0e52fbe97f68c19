"""Impact laws by name: built-in laws, registered laws, and laws of installed packages.

A package provides a law through the entry-point group ``ffsm_mj.impact_laws``: the name of the entry point is the name of
the law, and its object a subclass of :class:`~ffsm_mj.contact_models.impact.law.ImpactLaw` with a constructor without
arguments.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points

from ffsm_mj.contact_models.impact.builtin_laws import Blend, Newton, Poisson
from ffsm_mj.contact_models.impact.law import ImpactLaw
from ffsm_mj.errors import described

GROUP = "ffsm_mj.impact_laws"
_BUILT_IN: dict[str, ImpactLaw] = {law.name: law for law in (Blend(), Poisson(), Newton())}
_REGISTERED = dict(_BUILT_IN)


def register(law: ImpactLaw) -> None:
    """Register a law in this process, for scripts and tests that are not installed packages.

    Raises:
        ValueError: Another law has that name.
    """
    if _REGISTERED.setdefault(law.name, law) is not law:
        raise ValueError(f"another impact law has the name {law.name!r}")


def impact_laws() -> dict[str, ImpactLaw]:
    """All laws by name, built-in laws first."""
    plugins, _ = _plugins()
    return _REGISTERED | {name: law for name, law in plugins.items() if name not in _REGISTERED}


def impact_law(name: str) -> ImpactLaw:
    """Look up a law by name.

    Raises:
        LookupError: The law is unknown, or an installed package provides it and cannot be used; the message says which.
    """
    if law := _REGISTERED.get(name) or _plugins()[0].get(name):
        return law
    if fault := plugin_fault(name):
        raise LookupError(fault)
    raise LookupError(f"unknown impact law {name!r}; allowed: {', '.join(impact_laws())}")


def plugin_fault(name: str) -> str:
    """Why the law of this name of an installed package cannot be used; empty if it can, or if there is none."""
    broken = _plugins()[1].get(name)
    return f"the impact law {name!r} of an installed package cannot be used ({broken})" if broken else ""


def law_of_record(name: str) -> ImpactLaw:
    """The law that checks records with a given name: the law of that name, or one with a rule of that name.

    Records of an unknown law are checked by the default law, so a log cannot avoid a check by its name.
    """
    laws = impact_laws()
    by_rule = (law for law in laws.values() if name in law.rules)
    return laws.get(name) or next(by_rule, laws["blend"])


@cache
def _plugins() -> tuple[dict[str, ImpactLaw], dict[str, str]]:
    """Laws of installed packages, and why others cannot be used; evaluated once per process.

    A broken package affects only the scenarios that name its law; so does a law with the name of a built-in one.
    """
    laws, broken = dict[str, ImpactLaw](), dict[str, str]()
    for entry_point in entry_points(group=GROUP):
        if entry_point.name in _BUILT_IN:
            broken[entry_point.name] = f"{entry_point.value} has the name of a built-in impact law; rename it"
            continue
        try:
            laws[entry_point.name] = _loaded(entry_point)
        except Exception as error:  # noqa: BLE001 (a package may fail in any way)
            broken[entry_point.name] = described(error)
    return laws, broken


def _loaded(entry_point: EntryPoint) -> ImpactLaw:
    cls = entry_point.load()
    if not (isinstance(cls, type) and ImpactLaw in cls.__mro__):
        raise TypeError(f"{entry_point.value} is not a subclass of ffsm_mj.impact.ImpactLaw")
    law: ImpactLaw = cls()
    if law.name != entry_point.name:
        raise TypeError(f"{entry_point.value}: the entry point must have the name of the law, {law.name!r}")
    return law
