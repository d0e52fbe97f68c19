"""CoACD in a process of its own: its result, and what becomes of a child that dies, hangs or wants too much."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

from ffsm_mj.decomposition import coacd
from ffsm_mj.decomposition.distances import distances
from ffsm_mj.decomposition.gate import gate
from ffsm_mj.decomposition.surface import Surface
from ffsm_mj.errors import InputError
from tests.decomposition import meshes

NAME = "part.obj: mesh 'part'"


def bracket():
    return gate(*meshes.bracket(), NAME).surface


def test_pieces_are_those_of_a_bracket_and_the_same_again():
    pytest.importorskip("coacd")
    surface = bracket()
    first, second = (coacd.decompose(surface, None, NAME) for _ in range(2))
    assert len(first) == len(second) == 2
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
    apart = distances(surface, first)
    # Its cut misses the corner by a part of its grid: a fifth of a millimetre of 12 cm.
    assert 1e-6 < apart.outside_m < 5e-4
    assert apart.uncovered_m < 5e-4


def test_a_number_that_is_not_finite_ends_the_child_alone():
    """The gate refuses such a mesh; CoACD itself ends its process, or gives nothing."""
    pytest.importorskip("coacd")
    surface = bracket()
    vertices = surface.vertices.copy()
    vertices[0, 0] = np.nan
    with pytest.raises(InputError, match=r"CoACD (ended with|gives no piece)"):
        coacd.decompose(Surface(vertices, surface.faces), None, NAME)


@pytest.mark.parametrize(
    ("program", "what"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", r"CoACD ended with signal 11; simplify the mesh"),
        ("raise SystemExit('no')", r"CoACD ended with exit code 1 \(no\); simplify the mesh"),
        ("import time; time.sleep(60)", r"CoACD takes longer than 0\.5 s; simplify it or give a larger tolerance_m"),
        ("pass", r"CoACD ended with exit code 0; simplify the mesh"),
        ("import sys, numpy; numpy.savez(sys.argv[1] + '/pieces.npz', numpy.eye(3))", "CoACD gives no piece with a volume"),
    ],
)
def test_what_becomes_of_the_child_is_said(monkeypatch, program, what):
    monkeypatch.setattr(coacd, "_CHILD", program)
    monkeypatch.setattr(coacd, "installed_version", lambda: "1.0.14")
    if "sleep" in program:
        monkeypatch.setattr(coacd, "LONGEST_S", 0.5)
    start = time.monotonic()
    with pytest.raises(InputError, match=what) as refused:
        coacd.decompose(bracket(), None, NAME)
    assert refused.value.lines[0].startswith(f"{NAME}: ")
    assert time.monotonic() - start < 20.0


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of address space")
def test_the_child_has_a_limit_of_memory(monkeypatch):
    before, _, after = coacd._CHILD.partition("import coacd\n")
    assert after
    monkeypatch.setattr(coacd, "_CHILD", before + "np.ones(10**9)\n")
    monkeypatch.setattr(coacd, "installed_version", lambda: "1.0.14")
    with pytest.raises(InputError, match=r"exit code 1 \(.*allocate"):
        coacd.decompose(bracket(), None, NAME)
