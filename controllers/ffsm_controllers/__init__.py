"""Control laws. ``kinds()`` maps the ``kind`` of a scenario to its configuration model and class.

Laws of other packages plug in through the entry-point group ``ffsm_mj.controllers``: the entry point's name is the kind and
its object a class with a ``Config`` (a ``StrictModel`` of :mod:`ffsm_mj.controller_protocol` with a field ``kind``) that is
built as ``cls(config, context)``; see :class:`~ffsm_mj.controller_protocol.Controller`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ffsm_controllers.base_pd import BasePd
from ffsm_controllers.free_flying import FreeFlying
from ffsm_controllers.gripper import Gripper
from ffsm_controllers.hold import Hold
from ffsm_controllers.joint_path.law import JointPath
from ffsm_controllers.off import Off
from ffsm_controllers.osdre.law import Osdre
from ffsm_controllers.pd import Pd
from ffsm_controllers.track.law import Track
from ffsm_mj.controller_protocol import StrictModel

GROUP = "ffsm_mj.controllers"
_BUILT_IN: tuple[Any, ...] = (Off, Pd, Osdre, FreeFlying, Track, BasePd, Hold, Gripper, JointPath)


@dataclass(frozen=True)
class Kinds:
    """What a scenario may ask for.

    Attributes:
        classes: Controller class by kind; each has a ``Config``.
        broken: Why a plugin could not be used, by kind.
    """

    classes: dict[str, Any]
    broken: dict[str, str]


@cache
def kinds() -> Kinds:
    """Built-in laws and those of installed plugins; a broken plugin harms only the scenarios that ask for it.

    What is installed is looked up once: a run that starts takes what its scenario was validated with.
    """
    built_in = {_kind_of(cls): cls for cls in _BUILT_IN}
    found = Kinds(dict(built_in), {})
    for entry_point in entry_points(group=GROUP):
        if entry_point.name in built_in:
            found.broken[entry_point.name] = f"{entry_point.value} has the name of a built-in control law; rename it"
            continue
        try:
            found.classes[entry_point.name] = _load(entry_point)
        except Exception as error:  # noqa: BLE001 (a plugin may fail in any way)
            found.broken[entry_point.name] = f"{type(error).__name__}: {error}"
    return found


def _load(entry_point: EntryPoint) -> Any:
    cls = entry_point.load()
    config = getattr(cls, "Config", None)
    if not (isinstance(config, type) and issubclass(config, StrictModel)):
        raise TypeError(
            f"{entry_point.value} has no class attribute Config derived from ffsm_mj.controller_protocol.StrictModel"
        )
    if _kind_of(cls) != entry_point.name:
        raise TypeError(f"{entry_point.value}: the entry point's name must be the kind {_kind_of(cls)!r}")
    return cls


def _kind_of(cls: Any) -> str:
    """The one value of the field ``kind``."""
    values = cls.Config.model_fields["kind"].annotation.__args__
    return str(values[0])
