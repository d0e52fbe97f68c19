"""Control laws. ``kinds()`` maps the ``kind`` of a scenario to its configuration model and class.

Laws of other packages plug in through the entry-point group ``ffsm_mj.controllers``: the entry point's name is the kind and
its object a class with a ``Config`` (a ``StrictModel`` of :mod:`ffsm_mj.controller_protocol` with a field ``kind``) that is
built as ``cls(config, context)``; see :class:`~ffsm_mj.controller_protocol.Controller`.
"""

from __future__ import annotations

from functools import cache

from ffsm_controllers.plugins import Kinds, installed

GROUP = "ffsm_mj.controllers"
_BUILT_IN = {
    "off": ("off:OffConfig", "off:Off"),
    "pd": ("pd:PdConfig", "pd:Pd"),
    "osdre": ("osdre.law:OsdreConfig", "osdre.law:Osdre"),
    "free_flying": ("free_flying:FreeFlyingConfig", "free_flying:FreeFlying"),
    "track": ("track.config:TrackConfig", "track.law:Track"),
    "base_pd": ("base_pd:BasePdConfig", "base_pd:BasePd"),
    "transfer": ("transfer:TransferConfig", "transfer:Transfer"),
    "hold": ("hold:HoldConfig", "hold:Hold"),
    "gripper": ("gripper:GripperConfig", "gripper:Gripper"),
    "joint_path": ("joint_path.config:JointPathConfig", "joint_path.law:JointPath"),
    "playback": ("playback.config:PlaybackConfig", "playback.law:Playback"),
    "detumble": ("detumble.config:DetumbleConfig", "detumble.law:Detumble"),
    "gjm_rate": ("task_space.gjm_rate:GjmRateConfig", "task_space.gjm_rate:GjmRate"),
    "task_tj": ("task_space.task_tj:TaskTjConfig", "task_space.task_tj:TaskTj"),
    "task_ct": ("task_space.task_ct:TaskCtConfig", "task_space.task_ct:TaskCt"),
    "rns": ("task_space.rns:RnsConfig", "task_space.rns:Rns"),
    "lqr": ("task_space.lqr:LqrConfig", "task_space.lqr:Lqr"),
    "impedance": ("task_space.impedance:ImpedanceConfig", "task_space.impedance:Impedance"),
}


@cache
def kinds() -> Kinds:
    """Built-in laws and those of installed plugins; a broken plugin harms only the scenarios that ask for it.

    What is installed is looked up once: a run that starts takes what its scenario was validated with.
    """
    return installed(GROUP, _BUILT_IN, "control law")
