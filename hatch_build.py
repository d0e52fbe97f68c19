"""Build of the compiled core, ``ffsm_mj/_core``: by hatchling for wheels and editable installs, and by tests."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

CORE = Path("ffsm_mj", "_core")
# What memoryviews need, once for all modules: in each of them it would be 17 000 lines of C.
SHARED = "_memoryviews"
_LINK = {
    "darwin": ["-bundle", "-undefined", "dynamic_lookup", "-fPIC"],
    # Not yet tried. A DLL has no undefined symbols: those of Python are in its import library. -fPIC does not exist.
    "win32": ["-shared", f"-L{Path(sys.base_prefix, 'libs')}", "-lpython{}{}".format(*sys.version_info)],
}.get(sys.platform, ["-shared", "-fPIC"])
# Initialisers set every array, and classes say themselves how they are pickled; code for both is a tenth of the modules.
_CYTHON = ("-3", "-X", "initializedcheck=False,auto_pickle=False")
# -O2 takes ten seconds more of processor time, and runs are no faster. Products and sums are rounded separately, as in
# Python: fused ones would change last bits from one compiler to another.
_FLAGS = ["-O1", "-DNDEBUG", "-fwrapv", "-ffp-contract=off"]
_NO_HEADERS = (
    "ffsm-mj: Python.h is not in {folder}: install Python's headers (Debian, Ubuntu: apt install python3-dev), "
    "or use a Python that has them (uv run --managed-python ffsm)"
)


class CustomBuildHook(BuildHookInterface[Any]):
    """Compiles the core beside its sources, for wheels and editable installs."""

    def dependencies(self) -> list[str]:
        """A C compiler from a package, where the machine has none."""
        return [] if self.target_name != "wheel" or _compiler() else ["ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Build; wheels are tagged for the platform and this Python."""
        if self.target_name == "wheel":
            built = build(Path(self.root))
            build_data["artifacts"] += [path.relative_to(self.root).as_posix() for path in built]
            build_data |= {"pure_python": False, "infer_tag": True}


def build(root: Path, modules: Iterable[str] = ()) -> list[Path]:
    """Compile the core of a checkout, or of a copy.

    Args:
        root: Its folder.
        modules: Names of the modules to compile; none: all.

    Returns:
        The extension modules, beside their sources.

    Raises:
        SystemExit: There are no headers of Python.
        CalledProcessError: A source does not compile; the compiler has printed why.
    """
    python = Path(sysconfig.get_paths()["include"])
    if not (python / "Python.h").is_file():
        raise SystemExit(_NO_HEADERS.format(folder=python))
    mujoco = find_spec("mujoco")
    assert mujoco
    compiler = [*(_compiler() or [sys.executable, "-m", "ziglang", "cc"]), *_FLAGS]
    compiler += [f"-I{folder}" for folder in (python, Path(str(mujoco.origin)).parent / "include")]
    names = [*modules] or [SHARED, *(path.stem for path in sorted((root / CORE).glob("*.pyx")))]
    with tempfile.TemporaryDirectory() as scratch:
        copy = shutil.copytree(root / CORE, Path(scratch) / CORE)
        (copy.parent / "__init__.py").touch()  # Cython tells packages by it
        shared = ".".join((*CORE.parts, SHARED))
        _cython(scratch, f"--generate-shared={CORE / SHARED}.c")
        _cython(scratch, *_CYTHON, f"--shared={shared}", *(str(CORE / f"{name}.pyx") for name in names if name != SHARED))
        suffix = sysconfig.get_config_var("EXT_SUFFIX")
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for done in [
                pool.submit(subprocess.check_call, [*compiler, f"{name}.c", "-o", f"{name}{suffix}", *_LINK], cwd=copy)
                for name in names
            ]:
                done.result()
        built = [root / CORE / f"{name}{suffix}" for name in names]
        for module in () if modules else set((root / CORE).glob(f"*{suffix}")) - {*built}:
            module.unlink()  # of a source that is gone
        for module in built:
            module.unlink(missing_ok=True)  # what has it loaded keeps it, and so does a link to it
            shutil.move(copy / module.name, module)
        return built


def _cython(folder: str, *arguments: str) -> None:
    subprocess.check_call([sys.executable, "-m", "cython", *arguments], cwd=folder)


def _compiler() -> list[str]:
    """The C compiler of the machine; empty without one."""
    named = shlex.split(os.environ.get("CC", ""))
    return named or [found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))][:1]
