"""Groups of measured impacts on small data of known answers; and every fault of the data is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ffsm_mj.cli.main import main
from ffsm_mj.errors import InputError
from ffsm_mj.identification.fit import fit
from ffsm_mj.identification.impacts import least_errors, moment_balance
from ffsm_mj.validation.measured import cube, ellipse, sphere
from ffsm_mj.validation.measured.groups import GROUPS, PAGE, page_of
from ffsm_mj.validation.measured.tosses import HALF_WIDTH_M, RATE_HZ, SCALE, Toss, read_toss
from ffsm_mj.validation.measured.tossing import GRAVITY, TossTask, simulate, simulate_soft
from tests.validation.measured_files import legacy_tensor, toss_table, write_ellipses, write_script

DOCS = Path(__file__).parents[2] / "docs"
START = np.array([0.1, 0.2, 0.09, *Rotation.from_rotvec([0.3, 0.2, 0.1]).as_quat(scalar_first=True), 1, -0.5, 0, 3, 4, 5.0])


def silent(*_, **__):
    """Progress that is not displayed."""
    return


def test_exact_impacts_of_an_ellipse_are_read_and_fitted(tmp_path):
    impacts, published, digests = ellipse.read(write_ellipses(tmp_path / "data"))
    assert len(impacts) == 60
    assert len(published) == 6
    assert len(digests) == 2
    fitted = fit(impacts, "stronge")
    assert (fitted.mu.value, fitted.e.value) == pytest.approx((0.18, 0.59), abs=1e-5)
    assert least_errors(impacts).errors.max() < 1e-14
    assert moment_balance(impacts).r_squared == pytest.approx(1.0, abs=1e-12)


def test_the_command_prints_what_it_computed(tmp_path, capsys):
    folder = write_ellipses(tmp_path / "data")
    assert main(["validate", "measured-ellipse", "--data", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert "0.1800 [0.1800, 0.1800]  0.5900 [0.5900, 0.5900]" in out
    assert "momenta do not obey" not in out
    assert err.count("another version of the data") == 2
    assert "May be claimed" not in out  # these are not the data that claims are about


def test_a_reversed_tangent_is_reported_and_corrected(tmp_path):
    """Impacts of ours with the other sign: the bound of any law is then as far off as that of the published data."""
    folder = write_ellipses(tmp_path / "data", mirrored=True)
    impacts, _, _ = ellipse.read(folder)
    assert moment_balance(impacts).r_squared < 0.0
    assert np.median(least_errors(impacts).errors) > 0.1
    report = ellipse.report(folder, silent)
    (notice,) = report.notices
    assert "tangents reversed" in notice
    laws = {row[0]: row for row in report.tables[1].rows}
    assert laws["stronge"][1].startswith("0.1800 ")
    assert laws["bound of any law"][3].startswith("0.0000 ")
    assert report.failures == ()


def without(key):
    return lambda data, models: ({name: value for name, value in data.items() if name != key}, models)


def with_data(**changes):
    return lambda data, models: (data | {name: change(data[name]) for name, change in changes.items()}, models)


def not_finite(array):
    array[6, 2] = np.nan
    return array


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without("d"), "data_ellipse.mat: no variable 'd'; it has states_i, states_f, n"),
        (with_data(n=lambda n: n[:, :2]), "data_ellipse.mat: n is (60, 2) of float64; 3 columns of numbers are allowed"),
        (with_data(d=lambda d: d[:-1]), "data_ellipse.mat: data.d has 59 rows, data.states_i 60: one row for each impact"),
        (with_data(n=lambda n: n * (1, 1, 1e3)), "data_ellipse.mat: row 1: n = [0.0, 1.0, "),
        (with_data(d=lambda d: 2.0 * d), "allowed are (0, 1, c) and (1, 0, h) with hypot(c, h) of 0.024 to 0.036 m"),
        (with_data(states_f=not_finite), "data_ellipse.mat: states_f, row 7: not finite"),
        (lambda _, models: (np.zeros(3), models), "data_ellipse.mat: no struct 'data'; it has data"),
        (lambda data, _: (data, {"v": np.zeros(3)}), "v_models.mat: no variable 'v_models'; it has v"),
        (lambda data, _: (data, {"v_models": np.zeros((9, 18))}), "v_models has 9 rows, processed_data/data_ellipse.mat 60"),
    ],
)
def test_faults_of_an_ellipse_are_one_line(change, message, tmp_path, capsys):
    folder = write_ellipses(tmp_path / "data", change=change)
    assert main(["validate", "measured-ellipse", "--data", str(folder)]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


def test_a_file_of_another_kind_is_one_line(tmp_path, capsys):
    folder = write_ellipses(tmp_path / "data")
    (folder / "processed_data" / "v_models.mat").write_bytes(b"no matrix")
    assert main(["validate", "measured-ellipse", "--data", str(folder)]) == 2
    err = capsys.readouterr().err
    assert "v_models.mat: not a MATLAB file that can be read" in err
    assert err.count("\n") == 1


def test_a_toss_is_read_as_it_was_written():
    table = np.random.default_rng(0).uniform(1, 2, (6, 19))
    table[:, 3:7] /= np.linalg.norm(table[:, 3:7], axis=1, keepdims=True)
    toss = read_toss(legacy_tensor(table), "0.pt")
    np.testing.assert_array_equal(toss.positions, HALF_WIDTH_M * table[:, :3])
    np.testing.assert_array_equal(toss.quaternions, table[:, 3:7])
    np.testing.assert_array_equal(toss.velocities, HALF_WIDTH_M * table[:, 7:10])
    np.testing.assert_array_equal(toss.rates, table[:, 10:13])


POSES = np.tile([0.0, 0, 2, 1, 0, 0, 0, *[0.0] * 12], (6, 1))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (legacy_tensor(POSES, rebuild="_rebuild_parameter"), "it names torch._utils._rebuild_parameter"),
        (legacy_tensor(POSES, storage="FloatStorage"), "it names torch.FloatStorage"),
        (legacy_tensor(POSES[:, :13]), "a tensor of shape (1, 6, 13); (1, n, 19) is allowed"),
        (legacy_tensor(POSES)[:-8], "113 numbers for 6 frames of 19"),
        (legacy_tensor(2.0 * POSES), "columns 4 to 7 are no unit quaternions (norm 2)"),
        (legacy_tensor(np.nan * POSES), "6 frames; at least 3 of finite numbers are allowed"),
        (legacy_tensor(POSES[:2]), "2 frames; at least 3"),
        (
            legacy_tensor(POSES * ([HALF_WIDTH_M] * 3 + [1.0] * 16)),
            "the height in half widths of the cube, is 0.1048 to 0.1048",
        ),
        (b"PK\x03\x04 a newer file", "not a tensor of doubles of a toss"),
        (b"\x80\x02K\x01.K\x01.K\x01.", "it does not begin as a file of PyTorch before 1.6"),
        (b"", "not a tensor of doubles of a toss"),
    ],
)
def test_faults_of_a_toss_are_one_line(data, message):
    with pytest.raises(InputError) as caught:
        read_toss(data, "12.pt")
    assert str(caught.value).startswith("12.pt: ")
    assert message in str(caught.value)
    assert len(caught.value.lines) == 1


def test_a_toss_executes_nothing(tmp_path):
    """A pickle that writes a file when PyTorch's reader or Python's own loads it."""
    mark = tmp_path / "executed"
    data = f"cos\nsystem\n(S'touch {mark}'\ntR.".encode()
    with pytest.raises(InputError, match=r"it names os\.system"):
        read_toss(data, "0.pt")
    assert not mark.exists()


def in_flight(frames: int) -> Toss:
    """A cube in free flight under the gravity of the files' metre, from START raised to where it stays clear."""
    times = np.arange(frames) / RATE_HZ
    fall = np.outer(times**2, (0.0, 0.0, 0.5 * SCALE * GRAVITY))
    positions = START[:3] + np.array([0.0, 0.0, 0.5]) + np.outer(times, START[7:10]) - fall
    rotation = Rotation.from_quat(START[3:7], scalar_first=True)
    turned = rotation * Rotation.from_rotvec(np.outer(times, START[10:]))
    still = np.zeros((frames, 3))
    return Toss(positions, turned.as_quat(scalar_first=True), still, still)


def test_the_state_at_the_end_of_free_flight_is_that_of_its_parabola():
    toss = in_flight(20)
    assert toss.free_frames == 20
    assert toss.gravity() == pytest.approx(SCALE * GRAVITY, rel=1e-9)  # a parabola through 20 exact points, condition 1e4
    state = toss.free_flight_state(SCALE * GRAVITY)
    time = 19 / RATE_HZ
    np.testing.assert_allclose(state[:7], [*toss.positions[-1], *toss.quaternions[-1]], atol=1e-12)
    np.testing.assert_allclose(state[7:10], START[7:10] - (0, 0, SCALE * GRAVITY * time), atol=1e-11)
    np.testing.assert_allclose(state[10:], START[10:], atol=1e-10)


@pytest.mark.parametrize(("engine", "tolerance"), [(simulate, 1e-9), (lambda task: simulate_soft(task, scale=SCALE), 0.04)])
def test_both_engines_follow_a_flight(engine, tolerance):
    """Ours to the truncation of a constant rotation; MuJoCo's Euler step at 148 Hz is off by half a step of the fall."""
    toss = in_flight(20)
    start = START + np.array([0, 0, 0.5, *[0] * 10])
    motion = engine(TossTask(start, 20, 0.18, 0.25))
    assert np.abs(motion.positions - toss.positions).max() < tolerance
    assert (motion.rotations * toss.rotations.inv()).magnitude().max() < 1e-6
    assert motion.failures == ()


def test_tosses_of_our_own_are_predicted_exactly(tmp_path):
    """Too few to search on: with the (mu, e) that they were made with, only rounding is left."""
    folder = tmp_path / "data" / "tosses_processed"
    folder.mkdir(parents=True)
    for i in range(2):
        start = START + np.array([0.01 * i, 0, 0.03, *[0] * 10])
        (folder / f"{i}.pt").write_bytes(legacy_tensor(toss_table(TossTask(start, 20, 0.18, 0.25))))
    report = cube.report(tmp_path, silent)
    assert report.failures == ()
    assert [line.split(":")[0] for line in report.versions] == ["data/tosses_processed/*.pt"]
    whole = {row[0]: row for row in report.tables[2].rows}
    assert whole["ours"][1:] == ("0.000 [0.000, 0.000]", "0.0 [0.0, 0.0]")
    assert not whole["MuJoCo, as others fitted it"][1].startswith("0.000")
    assert report.tables[3].rows[0][-1] == "100 %"


def test_a_sphere_is_as_in_closed_form():
    """Sliding all along, or rolling at the end; 32.52 deg is the limit."""
    angles = np.array([1.0, 10.0, 32.5, 32.6, 45.0, 80.0])
    ours = sphere.by_our_law(angles)
    np.testing.assert_allclose(ours, sphere.in_closed_form(angles), atol=1e-12)

    np.testing.assert_allclose(ours[:3], 5.0 / 7.0, atol=1e-12)
    assert ours[4] == pytest.approx(1.0 - 0.092 * 1.98, abs=1e-12)


def test_a_compliant_sphere_slides_as_a_rigid_one_and_reverses_its_slip_below():
    """Alumina on glass: k_t / k_n = 0.859. Sliding all along it is Coulomb's law; at 20 deg slip reverses by some 0.4.

    A constraint that takes slip to zero, or a spring of the wrong sign, has none.
    """
    assert 1.0 / sphere.ELASTIC.compliance_ratio == pytest.approx(0.859, abs=5e-4)
    angles = np.array([20.0, 40.0, 60.0])
    ratios = sphere.by_our_law(angles, "compliant")
    np.testing.assert_allclose(ratios[1:], sphere.in_closed_form(angles)[1:], atol=1e-9)
    assert 0.38 < 3.5 * (1.0 - ratios[0]) - 1.0 < 0.44


def test_lists_of_a_script_are_read_without_executing_it(tmp_path, capsys):
    folder = write_script(tmp_path / "lethe", [10.0, 20.0, 45.0], [0.7, 0.6, 0.8])
    assert main(["validate", "measured-sphere", "--data", str(folder)]) == 0
    out, err = capsys.readouterr()
    rms = np.sqrt(np.mean((5.0 / 7.0 - np.array([0.7, 0.6])) ** 2))
    (between,) = (line.split() for line in out.splitlines() if "9 to 32.5 deg" in line and f"{rms:.4f}" in line)
    assert between[4:7] == ["2", "0.40", f"{rms:.4f}"]
    assert f"{3.5 * 0.4 - 1.0:.2f}" in out
    assert "another version of the data" in err


@pytest.mark.parametrize(
    ("angles", "ratios", "message"),
    [
        ([10.0, 20.0], [0.7], ": 2 numbers in theta_restitution_exp, 1 in restitution_exp: one for each impact"),
        ([0.2, 1.1], [0.7, 0.7], ": theta_restitution_exp: degrees between 0 and 90 are allowed"),
        ([10.0, 20.0], [0.7, 70.0], ": restitution_exp: ratios of tangential speeds, between 0 and 1.5, are allowed"),
        ([10.0, 95.0], [0.7, 0.7], ": theta_restitution_exp: degrees between 0 and 90 are allowed"),
        ("open('x')", [0.7], ":3: theta_restitution_exp: a list of numbers is allowed"),
        ([], [], ":3: theta_restitution_exp: a list of numbers is allowed"),
        ([1.0], ["a"], ":4: restitution_exp: a list of numbers is allowed"),
        ("(", [0.7], "not Python that can be read"),
    ],
)
def test_faults_of_a_script_are_one_line(angles, ratios, message, tmp_path, capsys):
    folder = write_script(tmp_path / "lethe", angles, ratios)
    assert main(["validate", "measured-sphere", "--data", str(folder)]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", GROUPS)
def test_without_data_the_command_says_what_it_needs(name, tmp_path, capsys):
    source = GROUPS[name].source
    assert main(["validate", name]) == 0
    assert f"Not run: `ffsm validate {name} --data DIR` computes it from a copy of {source.named}" in capsys.readouterr().out
    assert main(["validate", name, "--data", str(tmp_path / "nowhere")]) == 2
    err = capsys.readouterr().err
    assert source.repository in err
    assert source.commit in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["measured-cube", "measured-sphere", "--data", "."], "name one group"),
        (["measured-cube", "one-collision"], "groups of measured impacts are computed alone; unknown group 'one-collision'"),
        (["one-collision", "--data", "."], "--data belongs to one of measured-ellipse, measured-cube, measured-sphere"),
        (["measured-cube", "--check"], "--check leaves out measured impacts"),
        (["measured-cube", "--page", "."], "--page needs --data here"),
    ],
)
def test_options_that_do_not_go_together(words, message, capsys):
    assert main(["validate", *words]) == 2
    assert message in capsys.readouterr().err


def test_the_page_takes_only_the_examined_version(tmp_path, capsys):
    folder = write_script(tmp_path / "lethe", [10.0, 45.0], [0.7, 0.8])
    assert main(["validate", "measured-sphere", "--data", str(folder), "--page", str(tmp_path / "docs")]) == 2
    assert "the page is about that commit" in capsys.readouterr().err
    assert not (tmp_path / "docs").exists()


def test_a_section_is_written_and_the_others_stay(tmp_path, capsys, monkeypatch):
    """Numbers that count as the examined ones here, so that there is a page; then another group's section beside it."""
    folder = write_script(tmp_path / "lethe", [10.0, 45.0], [0.7, 0.8])
    monkeypatch.setattr(sphere, "other_versions", lambda *_: ())
    assert main(["validate", "measured-sphere", "--data", str(folder), "--page", str(tmp_path / "docs")]) == 0
    page = (tmp_path / "docs" / PAGE).read_text()
    assert "written:" in capsys.readouterr().out
    assert (tmp_path / "docs" / "figures" / "measured-sphere.png").stat().st_size > 1000
    assert page.count("Not run: ") == 2
    assert "| sliding, above 32.5 deg | 1 |" in page
    again = page_of(page, {"measured-cube": "## Cube"})
    assert "## Cube" in again
    assert "| sliding, above 32.5 deg | 1 |" in again
    assert again.count("Not run: ") == 1


def test_the_committed_page_is_of_the_present_template():
    page = (DOCS / PAGE).read_text()
    assert page_of(page, {}) == page
