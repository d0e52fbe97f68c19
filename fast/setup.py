"""The extension modules: every .pyx, and the .py that are links to sources of ffsm-mj."""

from pathlib import Path

from setuptools import Extension, setup

SOURCES = [*Path("ffsm_mj_fast").glob("*.pyx"), *Path("ffsm_mj_fast").glob("*_planar.py")]
# Products and sums are rounded one by one, as in Python: fused ones would give other last bits.
FLAGS = ["-ffp-contract=off", "-g0"]

setup(ext_modules=[Extension(f"ffsm_mj_fast.{path.stem}", [path.as_posix()], extra_compile_args=FLAGS) for path in SOURCES])
