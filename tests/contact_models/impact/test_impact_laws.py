"""An external impact law: the documented example, registered here and installed as a package."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.contact_models.impact import law as laws
from ffsm_mj.contact_models.impact.law import Blend
from ffsm_mj.errors import InputError, UnsupportedContactError
from ffsm_mj.impact import Contact, Coverage, ImpactLaw, ImpactSolution, register_law, resolve
from ffsm_mj.replay import replay_log
from ffsm_mj.scenario.schema import scenario_schema
from ffsm_mj.verification.check_result import Check
from tests.contact_models.impact.test_friction_runs import flat, off_centre
from tests.replays import proved
from tests.scenes import box, scene, two_balls

DOC = Path(__file__).parents[3] / "docs" / "impact-laws.md"
BLOCKS = dict(re.findall(r"```(python|toml|yaml)\n(.*?)```", DOC.read_text(), flags=re.DOTALL))
SEPARATION = 0.8 * 0.1**0.25
"""Of the documented law at 1 m/s, e = 0.8 and a yield speed of 0.1 m/s."""


@pytest.fixture
def registry(monkeypatch):
    """Registered laws are removed after the test."""
    monkeypatch.setattr(laws, "_REGISTERED", dict(laws._REGISTERED))


@pytest.fixture
def yielding(registry):  # noqa: ARG001 (what is registered here is forgotten)
    names: dict[str, type[ImpactLaw]] = {}
    exec(BLOCKS["python"], names)
    register_law(names["Yielding"]())


def restitution(checks) -> Check:
    (found,) = (check for check in checks if check.name == "impact restitution")
    return found


@pytest.mark.usefixtures("yielding")
def test_one_contact_is_solved_recorded_replayed_and_checked(tmp_path):
    run = ffsm_mj.run(two_balls(tmp_path, restitution=0.8, impact={"law": "yielding"}), out=tmp_path / "out", rerun=False)
    (impact,) = run.impacts
    assert (impact.law, impact.restitution_used) == ("yielding", 0.8)
    assert impact.separation_speed_m_s == pytest.approx(SEPARATION, rel=1e-14)
    read = ffsm_mj.load_run(tmp_path / "out")
    assert all(check.passes for check in all_checks(read))
    again = replay_log(read.log)
    assert (again.obstacle, again.agrees) == ("", True)
    # Newton's restitution, which the built-in laws are checked by, is not what this law says.
    forged = replace(impact, law="blend")
    assert laws.law_of_record("blend").restitution_residual([forged]) == pytest.approx(0.8 - SEPARATION)
    faster = replace(impact, separation_speed_m_s=0.8)
    assert laws.law_of_record("yielding").restitution_residual([faster]) == pytest.approx(0.8 - SEPARATION)


@pytest.mark.usefixtures("registry")
def test_a_law_that_breaks_its_own_check_fails_it(tmp_path):
    class Dead(ImpactLaw):
        """Plastic whatever e is; checked by the default, which expects e."""

        name = "dead"
        covers = Coverage()

        def solve(self, problem):
            return ImpactSolution(-problem.speeds / problem.inverse_masses)

    register_law(Dead())
    run = ffsm_mj.run(two_balls(tmp_path, restitution=0.8, impact={"law": "dead"}))
    check = restitution(all_checks(run))
    assert not check.passes
    assert check.residual == pytest.approx(0.8)


@pytest.mark.usefixtures("registry")
@pytest.mark.parametrize(("make", "mu"), [(off_centre, 0.3), (flat, 0.3), (flat, 0.0)])
def test_a_law_for_friction_and_several_contacts_is_recorded_and_verified(tmp_path, make, mu):
    class Renamed(ImpactLaw):
        """What ``blend`` answers, under its own name."""

        name = "renamed"
        covers = Coverage(friction=True)

        def solve(self, problem):
            return replace(Blend().solve(problem), rule="")

    register_law(Renamed())
    run = proved(ffsm_mj.run(make(tmp_path, mu=mu, impact={"law": "renamed"})))
    assert {impact.law for impact in run.impacts} == {"renamed"}
    other = proved(ffsm_mj.run(make(tmp_path, mu=mu)))
    np.testing.assert_array_equal(run.qvel, other.qvel)


@pytest.mark.usefixtures("yielding")
def test_problems_outside_the_coverage_are_refused(tmp_path):
    """Friction and e > 1 at load, several contacts at the impact."""
    pair = {"between": ["ball", "target/target"]}
    with pytest.raises(InputError, match=r"contacts.rules\.0\.mu: 'impact.law: yielding' does not cover friction"):
        prepare(two_balls(tmp_path, impact={"law": "yielding"}, contacts={"rules": [pair | {"mu": 0.1}]}))
    elastic = pair | {"restitution": 1.5, "super_elastic": True}
    with pytest.raises(InputError, match=r"contacts.rules\.0\.restitution: .* does not cover super-elastic impacts"):
        prepare(two_balls(tmp_path, impact={"law": "yielding"}, contacts={"rules": [elastic]}))
    faces = scene(
        tmp_path,
        box("a"),
        {"b": box("b")},
        duration_s=0.5,
        initial={"joints": {"b/free": [1.2, 0, 0, 1, 0, 0, 0]}, "rates": {"robot/free": [1, 0, 0, 0, 0, 0]}},
        contacts={"rules": [{"between": ["robot/a", "b/b"]}]},
        impact={"law": "yielding"},
    )
    run = ffsm_mj.run(faces)
    assert run.outcome == "unsupported_contact"
    assert "impact law 'yielding' does not cover several contacts at one instant" in run.message


@pytest.mark.usefixtures("registry")
@pytest.mark.parametrize("answer", [np.array([-1.0]), np.zeros(2)])
def test_a_solution_without_one_impulse_per_contact_is_refused(case_study, impact_state, answer):
    class Wrong(ImpactLaw):
        """Pulls, or speaks of two contacts."""

        name = "wrong"
        covers = Coverage()

        def solve(self, _):
            return ImpactSolution(answer)

    register_law(Wrong())
    robot, target = (case_study.mj.nbody - 2, case_study.mj.nbody - 1)
    normal = np.array([-1.0, 0.0, 0.0])
    contact = Contact(robot, target, np.array(impact_state.xpos[target]), normal)
    if resolve(case_study.mj, impact_state, [contact]).approach_speeds[0] <= 0.0:
        contact = replace(contact, normal=-normal)
    with pytest.raises(UnsupportedContactError, match="'wrong' does not return one impulse >= 0 per contact"):
        resolve(case_study.mj, impact_state, [contact], "wrong")


@pytest.mark.usefixtures("yielding")
def test_names_are_those_of_the_installed_laws(tmp_path):
    names = ["blend", "poisson", "newton", "compliant", "yielding"]
    assert scenario_schema()["$defs"]["ImpactConfig"]["properties"]["law"]["enum"] == names
    with pytest.raises(
        InputError, match=r"impact\.law: should be 'blend', 'poisson', 'newton', 'compliant' or 'yielding', got \"x\""
    ):
        prepare(two_balls(tmp_path, impact={"law": "x"}))
    with pytest.raises(ValueError, match="another impact law has the name 'yielding'"):
        register_law(type(laws.impact_law("yielding"))())


def ffsm(*arguments, packages=""):
    command = [sys.executable, "-m", "ffsm_mj.cli.main", *map(str, arguments)]
    environment = os.environ | {"PYTHONPATH": str(packages)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def package(tmp_path):
    """The files that ``pip install`` leaves of the documented package, and of one that cannot be imported."""
    folder = tmp_path / "package"
    info = folder / "my_impacts-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "my_impacts.py").write_text(BLOCKS["python"])
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my_impacts\nVersion: 1.0\n")
    ((group, laws),) = tomllib.loads(BLOCKS["toml"])["project"]["entry-points"].items()
    lines = [f"{name} = {place}" for name, place in laws.items()]
    (info / "entry_points.txt").write_text("\n".join((f"[{group}]", *lines, "broken = not_a_module:Law", "")))
    return folder


@pytest.mark.long
def test_an_installed_law_runs_and_is_verified(tmp_path, package):
    path, out = two_balls(tmp_path, restitution=0.8, impact={"law": "yielding"}), tmp_path / "out"
    done = ffsm("run", path, "--no-rerun", "--out", out, packages=package)
    assert done.returncode == 0, done.stderr
    (impact,) = json.loads((out / "summary.json").read_text())["impacts"]
    assert impact["law"] == "yielding"
    assert ffsm("analyze", out, packages=package).returncode == 0
    assert '"yielding"' in ffsm("schema", packages=package).stdout
    broken = ffsm("check", path, "-s", "impact.law=broken", packages=package)
    assert broken.returncode == 2
    assert "the impact law 'broken' of an installed package cannot be used (ModuleNotFoundError" in broken.stderr
    without = ffsm("analyze", out)
    assert without.returncode not in (0, 5)
    assert "the impact law 'yielding' of the log is not installed" in without.stdout + without.stderr
