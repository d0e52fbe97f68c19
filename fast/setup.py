"""Extension modules: every .pyx, and sources of ffsm-mj that are compiled unchanged."""

from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile

from setuptools import Extension, setup

PACKAGE, CHECKOUT = Path("ffsm_mj_fast"), Path("..")
# Copied from the checkout of ffsm-mj at every build, and contained in an sdist; Git ignores the copies.
ELSEWHERE = {
    PACKAGE / "riccati_planar.py": CHECKOUT / "controllers/ffsm_controllers/osdre/riccati_planar.py",
    PACKAGE / "osdre_planar.py": CHECKOUT / "controllers/ffsm_controllers/osdre/osdre_planar.py",
    Path("LICENSE"): CHECKOUT / "LICENSE",
}
# Products and sums are rounded separately, as in Python; fused operations would change the last bits.
FLAGS = ["-ffp-contract=off", "-g0"]


def extension(source: Path) -> Extension:
    """Extension module of a source file, compiled with MuJoCo's headers."""
    headers = Path(find_spec("mujoco").origin).parent / "include"
    return Extension(f"{PACKAGE}.{source.stem}", [source.as_posix()], include_dirs=[str(headers)], extra_compile_args=FLAGS)


if not Path("PKG-INFO").is_file():  # only an sdist has it
    for copy, original in ELSEWHERE.items():
        copyfile(original, copy)
sources = [*PACKAGE.glob("*.pyx"), *(path for path in ELSEWHERE if path.suffix == ".py")]
# Always rebuild: an earlier build may be for another version of MuJoCo.
setup(ext_modules=[extension(path) for path in sources], options={"build_ext": {"force": True}})
