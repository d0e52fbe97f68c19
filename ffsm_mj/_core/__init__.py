"""The compiled core (Cython): steps, contact rows and forces, control ticks, without Python objects inside a step.

``hatch_build.py`` compiles it, always: there is no other path. MuJoCo is called by its C functions, whose prototypes are
checked against ``mujoco.h`` when the core is compiled, and whose minor version when it is imported. An exception of Python
in a callback of MuJoCo (``mujoco.set_mjcb_control``) and an error in MuJoCo itself end the process here, whereas MuJoCo's
own bindings raise; nothing in ffsm-mj sets callbacks.
"""

from __future__ import annotations

from ffsm_mj.errors import CoreError, described

try:
    from ffsm_mj._core.functions import BUILT as BUILT
except ImportError as error:
    raise CoreError(described(error)) from error
