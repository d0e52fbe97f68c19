"""Addresses of MuJoCo's C functions, from the very library that the ``mujoco`` package has loaded."""

import ctypes
import sys
from pathlib import Path

import mujoco


def _library():
    version = mujoco.__version__
    names = {"win32": "mujoco.dll", "darwin": f"libmujoco.{version}.dylib"}
    path = Path(mujoco.__file__).parent / names.get(sys.platform, f"libmujoco.so.{version}")
    if not path.is_file():
        raise ImportError(f"ffsm-mj-fast needs {path}; set FFSM_COMPILED=0 to run without it")
    return ctypes.CDLL(str(path))


cdef void* _function(library, str name) except NULL:
    cdef size_t place = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
    return <void*>place


cdef void* address(struct) except NULL:
    """Where the C struct behind an MjModel or MjData is."""
    cdef size_t place = struct._address
    return <void*>place


cdef int _load() except -1:
    library = _library()
    mj.step = <void (*)(const void*, void*) noexcept nogil>_function(library, "mj_step")
    mj.forward = <void (*)(const void*, void*) noexcept nogil>_function(library, "mj_forward")
    mj.forward_skip = <void (*)(const void*, void*, int, int) noexcept nogil>_function(library, "mj_forwardSkip")
    mj.runge_kutta = <void (*)(const void*, void*, int) noexcept nogil>_function(library, "mj_RungeKutta")
    mj.check_pos = <void (*)(const void*, void*) noexcept nogil>_function(library, "mj_checkPos")
    mj.check_vel = <void (*)(const void*, void*) noexcept nogil>_function(library, "mj_checkVel")
    mj.check_acc = <void (*)(const void*, void*) noexcept nogil>_function(library, "mj_checkAcc")
    mj.get_state = <void (*)(const void*, const void*, double*, int) noexcept nogil>_function(library, "mj_getState")
    mj.mul_m = <void (*)(const void*, const void*, double*, const double*) noexcept nogil>_function(library, "mj_mulM")
    mj.solve_m = <void (*)(const void*, void*, double*, const double*, int) noexcept nogil>_function(library, "mj_solveM")
    mj.jac_site = <void (*)(const void*, const void*, double*, double*, int) noexcept nogil>_function(library, "mj_jacSite")
    mj.jac_body = <void (*)(const void*, const void*, double*, double*, int) noexcept nogil>_function(library, "mj_jacBody")
    mj.jac_dot = <void (*)(const void*, void*, double*, double*, const double*, int) noexcept nogil>_function(library, "mj_jacDot")
    mj.subtree_vel = <void (*)(const void*, void*) noexcept nogil>_function(library, "mj_subtreeVel")
    mj.object_velocity = <void (*)(const void*, const void*, int, int, double*, int) noexcept nogil>_function(library, "mj_objectVelocity")
    return 0


_load()
