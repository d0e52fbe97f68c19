"""Control laws. ``kinds()`` maps the ``kind`` of a scenario to its configuration model and class.

Laws of other packages plug in through the entry-point group ``ffsm_mj.controllers``: the entry point's name is the kind and
its object a class with a ``Config`` (a ``StrictModel`` of :mod:`ffsm_mj.controller_protocol` with a field ``kind``) that is
built as ``cls(config, context)``; see :class:`~ffsm_mj.controller_protocol.Controller`.
"""

from __future__ import annotations

from functools import cache

from ffsm_controllers.base_pd import BasePdConfig
from ffsm_controllers.detumble.config import DetumbleConfig
from ffsm_controllers.free_flying import FreeFlyingConfig
from ffsm_controllers.gripper import GripperConfig
from ffsm_controllers.hold import HoldConfig
from ffsm_controllers.joint_path.config import JointPathConfig
from ffsm_controllers.off import OffConfig
from ffsm_controllers.osdre.law import OsdreConfig
from ffsm_controllers.pd import PdConfig
from ffsm_controllers.playback.config import PlaybackConfig
from ffsm_controllers.plugins import Kinds, installed
from ffsm_controllers.task_space.gjm_rate import GjmRateConfig
from ffsm_controllers.task_space.impedance import ImpedanceConfig
from ffsm_controllers.task_space.lqr import LqrConfig
from ffsm_controllers.task_space.rns import RnsConfig
from ffsm_controllers.task_space.task_ct import TaskCtConfig
from ffsm_controllers.task_space.task_tj import TaskTjConfig
from ffsm_controllers.track.config import TrackConfig

GROUP = "ffsm_mj.controllers"
_BUILT_IN = (
    (OffConfig, "off:Off"),
    (PdConfig, "pd:Pd"),
    (OsdreConfig, "osdre.law:Osdre"),
    (FreeFlyingConfig, "free_flying:FreeFlying"),
    (TrackConfig, "track.law:Track"),
    (BasePdConfig, "base_pd:BasePd"),
    (HoldConfig, "hold:Hold"),
    (GripperConfig, "gripper:Gripper"),
    (JointPathConfig, "joint_path.law:JointPath"),
    (PlaybackConfig, "playback.law:Playback"),
    (DetumbleConfig, "detumble.law:Detumble"),
    (GjmRateConfig, "task_space.gjm_rate:GjmRate"),
    (TaskTjConfig, "task_space.task_tj:TaskTj"),
    (TaskCtConfig, "task_space.task_ct:TaskCt"),
    (RnsConfig, "task_space.rns:Rns"),
    (LqrConfig, "task_space.lqr:Lqr"),
    (ImpedanceConfig, "task_space.impedance:Impedance"),
)


@cache
def kinds() -> Kinds:
    """Built-in laws and those of installed plugins; a broken plugin harms only the scenarios that ask for it.

    What is installed is looked up once: a run that starts takes what its scenario was validated with.
    """
    return installed(GROUP, _BUILT_IN, "control law")
