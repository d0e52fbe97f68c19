"""Compiled twins of the most expensive classes of ffsm-mj: same names, same methods, same arithmetic.

Two modules are compiled sources of :mod:`ffsm_controllers`; the others use loops instead of small NumPy calls, and the C
functions of MuJoCo instead of its Python bindings.
"""

from ffsm_mj_fast.block_law import BlockLaw
from ffsm_mj_fast.contact_acceleration import ContactAcceleration
from ffsm_mj_fast.forced_stepper import ForcedStepper
from ffsm_mj_fast.free_stepper import FreeStepper
from ffsm_mj_fast.friction_state import FrictionState
from ffsm_mj_fast.held_rows import HeldForces
from ffsm_mj_fast.joint_work import JointWork
from ffsm_mj_fast.limits import Limits
from ffsm_mj_fast.loop_stage import LoopStage
from ffsm_mj_fast.planar_law import PlanarLaw
from ffsm_mj_fast.riccati_doubling import Doubling
from ffsm_mj_fast.riccati_planar import PlanarRiccati
from ffsm_mj_fast.rows import RowEvaluator
from ffsm_mj_fast.sampler import Sampler
from ffsm_mj_fast.smooth import Smooth
from ffsm_mj_fast.stage_forces import StageForces
from ffsm_mj_fast.stage_sums import StageSums
from ffsm_mj_fast.state_transfer import StateTransfer
from ffsm_mj_fast.steady import SteadyContacts
from ffsm_mj_fast.tip_kinematics import TipKinematics

INTERFACE = "7a8721c7964f"
"""Value of ``ffsm_mj.compiled.INTERFACE`` for which these twins are written; ffsm-mj refuses twins with another value."""

__all__ = [
    "INTERFACE",
    "BlockLaw",
    "ContactAcceleration",
    "Doubling",
    "ForcedStepper",
    "FreeStepper",
    "FrictionState",
    "HeldForces",
    "JointWork",
    "Limits",
    "LoopStage",
    "PlanarLaw",
    "PlanarRiccati",
    "RowEvaluator",
    "Sampler",
    "Smooth",
    "StageForces",
    "StageSums",
    "StateTransfer",
    "SteadyContacts",
    "TipKinematics",
]
