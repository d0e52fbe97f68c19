"""Control laws. ``kinds()`` maps the ``kind`` of a scenario to its configuration model and class.

Laws of other packages plug in through the entry-point group ``ffsm_mj.controllers``: the entry point's name is the kind and
its object a class with a ``Config`` (a ``StrictModel`` of :mod:`ffsm_mj.controller_protocol` with a field ``kind``) that is
built as ``cls(config, context)``; see :class:`~ffsm_mj.controller_protocol.Controller`.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from ffsm_controllers.base_pd import BasePd
from ffsm_controllers.detumble.law import Detumble
from ffsm_controllers.free_flying import FreeFlying
from ffsm_controllers.gripper import Gripper
from ffsm_controllers.hold import Hold
from ffsm_controllers.joint_path.law import JointPath
from ffsm_controllers.off import Off
from ffsm_controllers.osdre.law import Osdre
from ffsm_controllers.pd import Pd
from ffsm_controllers.playback.law import Playback
from ffsm_controllers.plugins import Kinds, installed
from ffsm_controllers.task_space.gjm_rate import GjmRate
from ffsm_controllers.task_space.impedance import Impedance
from ffsm_controllers.task_space.lqr import Lqr
from ffsm_controllers.task_space.rns import Rns
from ffsm_controllers.task_space.task_ct import TaskCt
from ffsm_controllers.task_space.task_tj import TaskTj
from ffsm_controllers.track.law import Track

GROUP = "ffsm_mj.controllers"
_TASK_SPACE = (GjmRate, TaskTj, TaskCt, Rns, Lqr, Impedance)
_BUILT_IN: tuple[Any, ...] = (
    Off,
    Pd,
    Osdre,
    FreeFlying,
    Track,
    BasePd,
    Hold,
    Gripper,
    JointPath,
    Playback,
    Detumble,
    *_TASK_SPACE,
)


@cache
def kinds() -> Kinds:
    """Built-in laws and those of installed plugins; a broken plugin harms only the scenarios that ask for it.

    What is installed is looked up once: a run that starts takes what its scenario was validated with.
    """
    return installed(GROUP, _BUILT_IN, "control law")
