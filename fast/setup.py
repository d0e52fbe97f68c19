"""The extension modules: every .pyx, and sources of ffsm-mj that are compiled as they stand."""

from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile

from setuptools import Extension, setup

PACKAGE, CHECKOUT = Path("ffsm_mj_fast"), Path("..")
# Each stands once, in a checkout of ffsm-mj: copied from there at every build, carried by an sdist. Git ignores the copies.
ELSEWHERE = {
    PACKAGE / "riccati_planar.py": CHECKOUT / "controllers/ffsm_controllers/osdre/riccati_planar.py",
    PACKAGE / "osdre_planar.py": CHECKOUT / "controllers/ffsm_controllers/osdre/osdre_planar.py",
    Path("LICENSE"): CHECKOUT / "LICENSE",
}
# Products and sums are rounded one by one, as in Python: fused ones would give other last bits.
FLAGS = ["-ffp-contract=off", "-g0"]


def extension(source: Path) -> Extension:
    """The module of a source, with MuJoCo's headers at hand."""
    headers = Path(find_spec("mujoco").origin).parent / "include"
    return Extension(f"{PACKAGE}.{source.stem}", [source.as_posix()], include_dirs=[str(headers)], extra_compile_args=FLAGS)


if not Path("PKG-INFO").is_file():  # which an sdist has
    for copy, original in ELSEWHERE.items():
        copyfile(original, copy)
sources = [*PACKAGE.glob("*.pyx"), *(path for path in ELSEWHERE if path.suffix == ".py")]
# Always anew: what is left of a build with another MuJoCo is no use.
setup(ext_modules=[extension(path) for path in sources], options={"build_ext": {"force": True}})
