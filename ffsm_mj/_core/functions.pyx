"""Addresses of MuJoCo's C functions in the library that the ``mujoco`` package has loaded."""

import ctypes
import sys
from pathlib import Path

import mujoco


cdef extern from "functions.h":
    const int mjVERSION_HEADER, COUNT
    const char* const* NAMES
    const char* COMPILER
    size_t* ADDRESSES
    void TAKE_ALL(Functions functions) noexcept  # a macro


def _minor(int version):
    """Major and minor version as text; 4000001 is MuJoCo 4.0.1."""
    return f"{version // 1_000_000}.{version // 1_000 % 1_000}"


def _library():
    """The loaded library.

    Raises:
        ImportError: Its minor version differs from that of the header at compile time, or the file does not exist.
    """
    version = mujoco.__version__
    # Structs change between minor versions: fields would be read at the places of others.
    if _minor(mujoco.mj_version()) != _minor(mjVERSION_HEADER):
        raise ImportError(f"built for MuJoCo {_minor(mjVERSION_HEADER)}, not {version}")
    names = {"win32": "mujoco.dll", "darwin": f"libmujoco.{version}.dylib"}
    path = Path(mujoco.__file__).parent / names.get(sys.platform, f"libmujoco.so.{version}")
    # Loading by name alone could find another library than the one whose structs Python holds.
    if not path.is_file():
        raise ImportError(f"there is no {path}")
    return ctypes.CDLL(str(path))


cdef void* address(struct) except NULL:
    """Address of the C struct of an MjModel or MjData."""
    cdef size_t place = struct._address
    return <void*>place


cdef int _load() except -1:
    cdef int i
    library = _library()
    for i in range(COUNT):
        ADDRESSES[i] = ctypes.cast(getattr(library, NAMES[i].decode()), ctypes.c_void_p).value
    TAKE_ALL(mj)
    return 0


_load()
BUILT = f"MuJoCo {_minor(mjVERSION_HEADER)}, {COMPILER.decode()}"
"""What the core is built for, and by which compiler: others round in other ways."""
