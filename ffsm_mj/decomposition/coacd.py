"""Approximate decomposition by CoACD (Wei et al. 2022), an optional package, in a process of its own.

The package is native code that ends its process on some input, takes any time on other, and prints. The child has limits on
time and memory; whatever becomes of it, the parent says so.
"""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ffsm_mj.decomposition.surface import Surface
from ffsm_mj.errors import InputError
from ffsm_mj.installation import add_extra
from ffsm_mj.polytope import Polytope, hull_of

LONGEST_S = 600.0
MOST_MEMORY = 4 * 1024**3
"""Address space of the child, bytes; it takes 0.3 GB for 5000 faces."""
_CONCAVITY = 0.05
"""CoACD's own default: greatest concavity of a piece over the size of the mesh."""
_SEED = 0
_CHILD = """
import sys
import numpy as np
folder, most_memory, threshold, metric, seed = sys.argv[1:]
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (int(most_memory),) * 2)
except ImportError:  # Windows has no such limit
    pass
import coacd
coacd.set_log_level("error")
mesh = np.load(folder + "/mesh.npz", allow_pickle=False)
pieces = coacd.run_coacd(
    coacd.Mesh(mesh["vertices"], mesh["faces"]),
    threshold=float(threshold),
    real_metric=metric == "m",
    preprocess_mode="off",
    seed=int(seed),
)
np.savez(folder + "/pieces.npz", *(vertices for vertices, _ in pieces))
"""
"""Program of the child. The gate has been passed: CoACD repairs nothing."""


def installed_version() -> str | None:
    """Version of the installed package; None without it."""
    try:
        return version("coacd")
    except PackageNotFoundError:
        return None


def decompose(surface: Surface, tolerance_m: float | None, name: str) -> list[Polytope]:
    """Convex pieces of about the shape of a solid.

    Args:
        surface: Its surface, beyond the gate.
        tolerance_m: Greatest concavity of a piece, m; None: 5 % of the size of the mesh.
        name: Name of the mesh in messages.

    Raises:
        InputError: The package is not installed, it fails, or it takes too much time or memory.
    """
    if installed_version() is None:
        raise InputError(f"{name}: 'method: coacd' needs the package coacd; install it: {add_extra('coacd', 'coacd')}")
    with TemporaryDirectory(prefix="ffsm-coacd-") as folder:
        np.savez(Path(folder, "mesh.npz"), vertices=surface.vertices, faces=surface.faces.astype(np.int32))
        threshold, metric = (_CONCAVITY, "relative") if tolerance_m is None else (tolerance_m, "m")
        arguments = (folder, str(MOST_MEMORY), repr(threshold), metric, str(_SEED))
        try:
            ended = subprocess.run(
                [sys.executable, "-c", _CHILD, *arguments], capture_output=True, timeout=LONGEST_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise InputError(
                f"{name}: CoACD takes longer than {LONGEST_S:g} s; simplify it or give a larger tolerance_m"
            ) from None
        result = Path(folder, "pieces.npz")
        if ended.returncode or not result.is_file():
            said = ended.stderr.decode(errors="replace").strip().splitlines()[-1:]
            how = f"signal {-ended.returncode}" if ended.returncode < 0 else f"exit code {ended.returncode}"
            raise InputError(f"{name}: CoACD ended with {how}{f' ({said[0]})' if said else ''}; simplify the mesh")
        with np.load(result, allow_pickle=False) as arrays:
            points = [np.asarray(arrays[key], dtype=np.float64) for key in arrays.files]
    pieces = []
    for corners in points:
        try:
            pieces.append(hull_of(corners, surface.rounding))
        except ValueError:  # a sliver without volume, which no distance sees
            continue
    if not pieces:
        raise InputError(f"{name}: CoACD gives no piece with a volume; simplify the mesh")
    return pieces
