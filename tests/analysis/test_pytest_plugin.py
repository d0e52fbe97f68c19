"""The plugin as a user's tests see it: found by pytest itself, light, and clear when a check fails."""

from __future__ import annotations

import subprocess
import sys

from tests.scenes import two_balls

TESTS = """
from dataclasses import replace
from ffsm_mj.analysis.run import Run
from ffsm_mj.pytest_plugin import assert_conserved

def test_once(ffsm_run):
    run = ffsm_run("scene.yaml", {"duration_s": 0.35})
    assert run is ffsm_run("scene.yaml", {"duration_s": 0.35})
    assert run is not ffsm_run("scene.yaml", {"duration_s": 0.4})
    assert ffsm_run(run.path.parent).impacts == ffsm_run(run.path).impacts == run.impacts
    assert_conserved(run)
    assert_conserved(run, {"energy": 1e-12}, checks=["energy", "linear momentum"])

def test_violated(ffsm_run):
    run = ffsm_run("scene.yaml")
    rows = run.log.rows.copy()
    rows[200, run.keys.index("energy.robot_J")] += 1e-6  # a leak
    assert_conserved(Run(replace(run.log, rows=rows)))
"""


def test_a_users_tests(pytester):
    two_balls(pytester.path, speed=3.7, restitution=0.3)
    pytester.makepyfile(TESTS)
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(
        [
            "*AssertionError: scene: 1 of 15 checks failed in 1 s*",
            "*energy of robot: residual 1.000e-06 J in T at 0.200 s, allowed *e-*",
        ]
    )


def test_what_cannot_be_asserted_says_so(pytester):
    two_balls(pytester.path, conservative=False, duration_s=0.01)
    text = (pytester.path / "target.xml").read_text().replace('type="slide"', 'type="slide" damping="2"')
    (pytester.path / "target.xml").write_text(text)
    pytester.makepyfile(
        """
        import pytest
        from ffsm_mj.pytest_plugin import assert_conserved

        def test_dissipation(ffsm_run):
            run = ffsm_run("scene.yaml")
            with pytest.raises(AssertionError, match="scene is not conservative: .*damping"):
                assert_conserved(run)
            with pytest.raises(ValueError, match="unknown check 'charm'; allowed: "):
                assert_conserved(run, checks=["charm"])
            with pytest.raises(ValueError, match="a finished run"):
                ffsm_run(run.path, ["duration_s=1"])
        """
    )
    pytester.runpytest_inprocess("-p", "no:cacheprovider").assert_outcomes(passed=1)


def test_importing_the_plugin_costs_nothing_and_changes_nothing():
    code = """
import os, sys
import pytest
before, environment = set(sys.modules), dict(os.environ)
import ffsm_mj.pytest_plugin
print(sorted(name for name in set(sys.modules) - before), environment == dict(os.environ))
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "['ffsm_mj', 'ffsm_mj.pytest_plugin'] True"
