"""Fixtures shared by the suite: the case study, and one baseline run on disk; and what ``--long`` means."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from filelock import FileLock

import ffsm_mj
from ffsm_mj.analysis.run import Run
from ffsm_mj.contact_models import registry as contact_models
from ffsm_mj.model.system import System
from ffsm_mj.records import kinds
from ffsm_mj.scenario.shipped import scenarios_dir
from tests import long_share
from tests.collection import pytest_collection, pytest_make_collect_report  # noqa: F401 (found by pytest)
from tests.contact_models.joint_friction.drive import Drive
from tests.contact_models.spring import Spring
from tests.contact_models.weld import Weld
from tests.long_share import (  # noqa: F401 (found by pytest)
    pytest_addoption,
    pytest_collection_modifyitems,
    pytest_runtest_logreport,
    pytest_sessionfinish,
)
from tests.scenes import compile_paths

MJCF = scenarios_dir().parent / "mjcf"

# Impact state of the case study (paper, Appendix A, to nine decimals): base x, y, yaw, three joints.
IMPACT_Q = (5.861471773, -0.338246268, -0.915080772, 1.579750822, 2.951931444, -0.811121967)
IMPACT_V = (0.120940886, -0.073253284, -0.012543561, 0.013182572, -0.273187717, 0.549455083)


def pytest_configure(config: pytest.Config) -> None:
    """Where Python is told to keep no bytecode, each of the suite's many processes would compile its imports anew."""
    if sys.dont_write_bytecode and hasattr(config, "cache"):
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        os.environ["PYTHONPYCACHEPREFIX"] = str(config.cache.mkdir("bytecode"))
    long_share.pytest_configure(config)
    # Nothing here renders with MuJoCo, which would look for GLFW in each process, by a process of its own.
    os.environ.setdefault("MUJOCO_GL", "disable")
    # Commands in messages begin as the user called the program; the suite may or may not run under uv.
    os.environ.pop("UV_RUN_RECURSION_DEPTH", None)
    # The tests have all processors already: threads of BLAS would wait for each other's.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def case_study() -> System:
    return compile_paths(MJCF / "ffsm_3dof.xml", {"object": MJCF / "box_1m.xml"})


@pytest.fixture
def impact_state(case_study):
    """Data at the case study's impact state."""
    data = mujoco.MjData(case_study.mj)
    data.qpos[:6], data.qpos[6:8] = IMPACT_Q, (3.5, -0.5)
    data.qvel[:6] = IMPACT_V
    mujoco.mj_forward(case_study.mj, data)
    return data


@pytest.fixture(scope="session")
def baseline(ffsm_run, tmp_path_factory, worker_id) -> Run:
    """One whole baseline run with its Rerun recording, as its log tells it: read with the reader that users use.

    Simulated once, by whichever of pytest's workers comes first.
    """
    shared = tmp_path_factory.getbasetemp()
    folder = (shared if worker_id == "master" else shared.parent) / "baseline"
    with FileLock(f"{folder}.lock"):
        if not (folder / "summary.json").is_file():
            ffsm_mj.run("baseline", out=folder)
    return ffsm_run(folder)


@pytest.fixture(scope="session")
def baseline_folder(baseline) -> Path:
    """Run folder of the baseline."""
    return baseline.path.parent


@pytest.fixture
def example_contact_models(monkeypatch) -> None:
    """The contact models that exist in tests only are known, registered like any other."""
    monkeypatch.setattr(contact_models.PLUGINS, "registered", dict(contact_models.PLUGINS.registered))
    monkeypatch.setattr(kinds, "_KNOWN", dict(kinds._KNOWN))
    for contact_model in (Drive, Spring, Weld):
        contact_models.register(contact_model)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240601)
