"""Every element and attribute of MJCF is modelled, irrelevant, refused or noted, as docs/mjcf.md says; transmissions."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.errors import InputError
from tests.model.mjcf_cases import COMPARED, LEFT_OUT, MARKED, SERVOS, WITHOUT_FORCE, mjcf, written
from tests.scenes import ball, compile_paths, scene

PAGE = Path(__file__).parents[2] / "docs" / "mjcf.md"
STATES = 10
DISABLED = int(
    mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
)


@cache
def schema() -> dict[str, frozenset[str]]:
    """Attributes of each element by its path, such as ``body/joint``; classes of ``default`` have those of the element."""
    found: dict[str, set[str]] = {}
    parents: list[str] = []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        if head := re.match(r"( *)(\S+) \([!*?R]\)", line):
            parents[len(head[1]) // 3 :] = [head[2].replace("(world)", "")]
        listed = line[head.end() :] if head else line
        found.setdefault("/".join(parents[1:]) or parents[0], set()).update(listed.split())
    return {path: frozenset(attributes) for path, attributes in found.items()}


def defaults() -> dict[str, frozenset[str]]:
    return {path.removeprefix("default/"): each for path, each in schema().items() if path.startswith("default/")}


@cache
def pairs() -> set[tuple[str, str]]:
    return {
        (path, attribute)
        for path, attributes in schema().items()
        if path.split("/")[0] != "default"
        for attribute in attributes
    }


@cache
def rows() -> tuple[tuple[tuple[str, ...], tuple[str, ...], str], ...]:
    """Elements, attributes and word of each row of the page."""
    found: list[tuple[tuple[str, ...], tuple[str, ...], str]] = []
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and cells[0] not in ("element", "---"):
            named = tuple(re.findall("`([^`]+)`", cells[0]))
            if cells[0] == "as above":
                named = found[-1][0]
            found.append((named, tuple(re.findall("`([^`]+)`", cells[1])), cells[2]))
    return tuple(found)


@cache
def pairs_of(named: tuple[str, ...], attributes: tuple[str, ...]) -> set[tuple[str, str]]:
    return {
        (path, attribute)
        for path, attribute in pairs()
        if any(path == each or (each.endswith("/**") and f"{path}/".startswith(each[:-2])) for each in named)
        and (attributes == ("*",) or attribute in attributes)
    }


@cache
def marked(*words: str) -> set[tuple[str, str]]:
    return {pair for named, attributes, word in rows() if word in words for pair in pairs_of(named, attributes)}


def test_every_attribute_is_in_exactly_one_row():
    """A MuJoCo with a new element or attribute fails here until someone has sorted it."""
    assert len(pairs()) > 1000
    counted = Counter(pair for named, attributes, _ in rows() for pair in pairs_of(named, attributes))
    assert sorted(pairs() - counted.keys()) == []
    assert sorted(pair for pair, times in counted.items() if times > 1) == []
    assert {word for *_, word in rows()} == {"modelled", "irrelevant", "refused", "noted"}


def test_no_row_names_what_the_schema_lacks():
    for named, attributes, _ in rows():
        for each in named:
            assert pairs_of((each,), ("*",)), each
        for attribute in attributes:
            assert pairs_of(named, (attribute,)), (named, attribute)


def test_classes_of_default_have_attributes_of_their_elements():
    homes = {"equality": "equality/", "tendon": "tendon/", "": "default"}
    for path, attributes in defaults().items():
        home = homes.get(path)
        known = {
            attribute
            for other, listed in schema().items()
            if (other.startswith(home) if home else other.endswith(f"/{path}")) and not other.startswith("default/")
            for attribute in listed
        }
        assert attributes <= known, path


@pytest.mark.parametrize("where", sorted(MARKED))
def test_what_is_refused_or_noted_is_named(tmp_path, where):
    """By the name of the attribute or of its element, with file and line."""
    path, _, attribute = where.partition("@")
    written(tmp_path, mjcf(**MARKED[where]))
    words = {word for named, attributes, word in rows() if (path, attribute or "*") in _cases_of(named, attributes)}
    assert len(words) == 1
    # A servo is refused by the name of the actuator, and constraints of a flex with the flex.
    said = rf"(\b{attribute or path.rpartition('/')[2].replace('flexstrain', 'flex')}|'probe')"
    if words == {"refused"}:
        with pytest.raises(InputError, match=rf"robot\.xml(:\d+)?: .*{said}") as refused:
            compile_paths(tmp_path / "robot.xml")
        text = str(refused.value)
    else:
        text = "\n".join(compile_paths(tmp_path / "robot.xml").notes)
        assert re.search(rf"robot\.xml(:\d+)?: .*{said}", text), text


def _cases_of(named: tuple[str, ...], attributes: tuple[str, ...]) -> set[tuple[str, str]]:
    """Cases that a refused or noted row needs: one for each element with ``*``, and one for each attribute of others."""
    if attributes == ("*",):
        return {(each.removesuffix("/**"), "*") for each in named}
    return pairs_of(named, attributes)


def test_everything_refused_or_noted_has_a_case():
    needed = {
        f"{path}@{attribute}".removesuffix("@*")
        for named, attributes, word in rows()
        if word in ("refused", "noted")
        for path, attribute in _cases_of(named, attributes)
    }
    # Height fields depend on what can meet them, so they are noted of a whole scenario.
    elsewhere = {"body/geom@hfield", "asset/hfield"}
    per_sensor = {each for each in needed if re.fullmatch("sensor/.*@interp", each)} - {"sensor/gyro@interp"}
    assert needed - elsewhere - per_sensor == set(MARKED)


def test_a_height_field_is_noted(tmp_path):
    field = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 1" elevation="0 1 0 1"/></asset><worldbody>'
    robot = ball("robot", extra='<geom name="field" type="hfield" hfield="h"/>').replace("<worldbody>", field)
    rules = {"rules": [{"between": ["robot", "ball"]}]}
    at = {"joints": {"ball/free": [5, 0, 0, 1, 0, 0, 0]}}
    (note,) = prepare(scene(tmp_path, robot, {"ball": ball()}, contacts=rules, initial=at)).notes()
    assert "geom 'robot/field' is a height field" in note


def forces(model, data, qpos, qvel, ctrl):
    """What MuJoCo computes at a state: mass matrix, bias, passive and actuator forces, accelerations."""
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass, data.qfrc_bias, data.qfrc_passive, data.qfrc_actuator, data.qacc


def differences(one, other):
    """Greatest difference of each of the forces of two models at random states, relative to their scale."""
    assert (one.nq, one.nv, one.nu) == (other.nq, other.nv, other.nu)
    rng, worst = np.random.default_rng(0), 0.0
    data = mujoco.MjData(one), mujoco.MjData(other)
    for _ in range(STATES):
        qpos, qvel, ctrl = rng.normal(size=one.nq), rng.normal(size=one.nv), 3.0 * rng.normal(size=one.nu)
        mujoco.mj_normalizeQuat(one, qpos)
        both = forces(one, data[0], qpos, qvel, ctrl), forces(other, data[1], qpos, qvel, ctrl)
        for a, b in zip(*both, strict=True):
            worst = max(worst, float(np.max(np.abs(a - b)) / max(1.0, np.max(np.abs(a)))))
    return worst


def alone(path):
    """The file as MuJoCo itself compiles it, without contacts and limits, which contact models replace.

    Forces follow from activations of the same instant: those of the next one are an artefact of its steps.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= DISABLED
    model.actuator_actearly[:] = 0
    return model


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return alone(written(tmp_path_factory.mktemp("plain"), mjcf()))


def merged(cases):
    """One case with the changes of several."""
    found = {}
    for case in cases:
        for where, change in case.items():
            if isinstance(change, str):
                found[where] = found.get(where, "") + (change if change not in found.get(where, "") else "")
            else:
                found[where] = found.get(where, {}) | change
    return found


def assert_equal_to_alone(folder, case):
    """The scene has mass matrix, bias, passive and actuator forces and accelerations of MuJoCo's own compile of the file."""
    own = alone(written(folder, mjcf(**case)))
    # The same operations in the same order, but for sums over a tree that begins one body later: rounding only.
    assert differences(own, compile_paths(folder / "robot.xml", conservative=False).mj) < 1e-9
    return own


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("where", [where for where in COMPARED if tuple(where.split("@")) in marked("modelled")])
def test_what_is_modelled_is_that_of_the_file_alone(tmp_path, plain, where):
    """An attribute that is modelled also changes some of the forces, or the case would prove nothing."""
    own = assert_equal_to_alone(tmp_path, COMPARED[where])
    if where not in WITHOUT_FORCE:
        assert (own.nv, own.nu) != (plain.nv, plain.nu) or differences(own, plain) > 1e-6


@pytest.mark.parametrize("path", sorted({where.partition("@")[0] for where in COMPARED}))
def test_what_is_irrelevant_changes_no_force(tmp_path, plain, path):
    """All irrelevant attributes of an element at once, and those left out: they change nothing, in the scene or alone."""
    without_force = marked("irrelevant") | {tuple(where.split("@")) for where in LEFT_OUT}
    pairs_here = [pair for pair in without_force if pair[0] == path and "@".join(pair) in COMPARED]
    own = assert_equal_to_alone(tmp_path, merged(COMPARED["@".join(pair)] for pair in sorted(pairs_here)))
    if (kind := path.rpartition("/")[2]) in SERVOS:
        needed = " ".join(f'{name}="{value}"' for name, value in SERVOS[kind].items())
        plain = alone(written(tmp_path, mjcf(in_actuator=f'<{kind} joint="j2" {needed}/>')))
    assert differences(own, plain) == 0.0


def test_every_attribute_of_the_plant_is_compared():
    """All that are modelled or irrelevant, of elements that could change the motion."""
    plant = re.compile(
        r"compiler|option(/.*)?|body(/(inertial|joint|freejoint|geom|site))?|tendon/[^/]*|actuator/.*|contact/.*"
    )
    of_files = {"name", "class", "childclass", "assetdir", "meshdir", "strippath", "texturedir"}
    of_runs = {"delay", "nsample"}  # of the command, before MuJoCo has it
    needed = {
        f"{path}@{attribute}"
        for path, attribute in marked("modelled", "irrelevant")
        if plant.fullmatch(path) and attribute not in of_files | of_runs
    }
    assert needed | LEFT_OUT == set(COMPARED)


TRANSMISSIONS = {
    "gear": {"actuator/motor": {"gear": "3"}},
    "rotor of a motor": {"actuator/motor": {"armature": "0.2", "gear": "3"}},
    "delay": {"actuator/motor": {"delay": "0.01", "nsample": "20"}},
    "limits": {"actuator/motor": {"forcerange": "-.2 .2", "gear": "2"}},
    "fixed tendon": {"in_actuator": '<motor name="x" tendon="tf" gear="2" armature="0.1"/>'},
    "spatial tendon": {"in_actuator": '<motor name="x" tendon="ts" armature="0.1"/>'},
    "inertia of tendons": {"tendon/fixed": {"armature": "0.3"}, "tendon/spatial": {"armature": "0.2"}},
    "two sites": {"in_actuator": '<motor name="x" site="t2" refsite="s" gear="1 0.5 0 0.2 0 0.3"/>'},
    "site": {"in_actuator": '<motor name="x" site="t2" gear="1 0.5 0 0.2 0 0.3"/>'},
    "slider-crank": {"in_actuator": '<motor name="x" cranksite="t2" slidersite="s" cranklength="1"/>'},
    "ball joint in its parent": {"in_actuator": '<motor name="x" jointinparent="jb" gear="0.1 0 0.2"/>'},
    "free joint in its parent": {"in_actuator": '<motor name="x" jointinparent="free" gear="0.1 0 0.2"/>'},
    "spring and damper": {"body/joint": {"springdamper": "0.5 1", "ref": "30", "pos": ".1 .2 .3", "armature": "0.1"}},
    "polynomials": {"body/joint": {"stiffness": "1 2 3", "springref": "20", "damping": ".1 .2 .3"}},
}


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("what", TRANSMISSIONS)
def test_what_acts_is_entered_in_the_balance(tmp_path, what):
    """A run with efforts of every transmission that is accepted passes its energy and momentum checks."""
    case = TRANSMISSIONS[what]
    names = ["m", "g", *(["x"] if "in_actuator" in case else [])]
    signs = [(-1) ** (k // 2) * (1.0 + 0.1 * k) for k in range(10)]
    rows_played = [
        f"{0.01 * k:.2f}," + ",".join(f"{s * (1 - 0.3 * i)}" for i in range(len(names))) for k, s in enumerate(signs)
    ]
    (tmp_path / "efforts.csv").write_text("\n".join((",".join(("time_s", *names)), *rows_played)))
    written(tmp_path, "")
    rates = {"free": [0.1, -0.2, 0.1, 0.3, 0.2, -0.4], "j1": 0.5, "j2": -1.0, "jb": [1.0, -0.7, 0.4]}
    columns = {name: {"column": name, "unit": "N" if name == "x" and "ball" not in what else "N m"} for name in names}
    playback = {"kind": "playback", "file": "efforts.csv", "columns": columns}
    path = scene(tmp_path, mjcf(**case), {}, duration_s=0.1, time_step_s=5e-4, initial={"rates": rates},
        phases=[{"name": "play", "until": "end", "controller": playback}])  # fmt: skip
    run = ffsm_mj.run(path, rerun=False)
    assert [check.name for check in all_checks(run) if not check.passes] == []
    assert {"energy", "linear momentum", "angular momentum"} <= {check.name for check in all_checks(run)}
