"""The page, its tables and its pictures from tables of known content."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.experiments.campaign import Campaign
from ffsm_mj.experiments.executors import loop
from ffsm_mj.experiments.figures import save_figures
from ffsm_mj.experiments.page import report_page
from ffsm_mj.experiments.report import write_report
from ffsm_mj.experiments.results import VariantResults
from ffsm_mj.experiments.sentences import sentences_of
from tests.experiments.files import rock_hits
from tests.experiments.made_up import config_of, results, row


def page(found, **keys):
    return report_page(VariantResults(config_of(**keys), {"": found}), None, ())


def cells(text, name):
    """Cells of the first row of a page that begins with a name."""
    line = next(line for line in text.splitlines() if line.startswith(f"| {name} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


@pytest.fixture
def many():
    rng = np.random.default_rng(3)
    rows = []
    for i, (x, noise) in enumerate(rng.random((128, 2))):
        bad = x > 0.9
        rows.append(
            row(
                i,
                outcome="diverged" if bad else "completed",
                success=not bad and noise < 0.8,
                x=float(x),
                x_noise=float(noise),
                y=None if bad else float(x * x),
                y_flat=7.769248852,
                y_some=float(i) if i < 40 else None,
            )
        )
    return rows


def test_shares_with_their_intervals(many):
    text = page(results(many), success="y < 1")
    failed = sum(each["failed"] for each in many)
    assert cells(text, "outcome `diverged`")[0] == f"{failed} of 128"
    successes = sum(each["success"] for each in many)
    assert cells(text, "success")[0] == f"{successes} of 128"
    assert "A run is a success if `y < 1` and its checks pass." in text
    assert "approximate" not in text


def test_the_example_in_the_documentation_has_the_headings_of_a_page(many):
    """``make campaign`` writes it."""
    example = (Path(__file__).parents[2] / "docs" / "campaign-example.md").read_text()
    headings = [re.findall("^## .*", text, re.MULTILINE) for text in (example, page(results(many)))]
    assert headings[0] == headings[1]


def test_no_failure_has_an_upper_end():
    text = page(results([row(i, x=float(i), y=float(i)) for i in range(64)]))
    assert cells(text, "failed (not completed, or a check fails)") == ["0 of 64", "0 %", "0 % to 5.66 %"]


@pytest.mark.parametrize(("kind", "points"), [("sobol", "Sobol points"), ("lhs", "points of a Latin hypercube")])
def test_intervals_of_dependent_points_are_called_approximate(many, kind, points):
    assert f"They are approximate: {points} are not independent samples." in page(results(many, kind=kind))


def test_metrics_say_where_there_is_no_bound_and_what_is_constant(many):
    text = page(results(many))
    assert cells(text, "`y_flat`")[:3] == [str(sum(not each["failed"] for each in many)), "7.769", "constant"]
    some = cells(text, "`y_some`")
    assert "no upper bound with fewer than 72 runs" in some[4]
    assert "no lower bound with fewer than 72 runs" in some[2]
    assert re.fullmatch(r"[\d.]+ \([\d.]+ to [\d.]+\)", some[3])


def test_a_metric_may_be_called_as_what_is_derived():
    found = results([row(i, x=float(i), good=float(i % 3)) for i in range(8)], metrics=("good",))
    assert found.frame["run:good"].all()
    assert cells(page(found), "`good`")[1] == "0"


def test_sensitivity_of_what_is_constant(many):
    text = page(results(many)).partition("## Sensitivity")[2]
    assert cells(text, "`y`")[0] == "1.00"
    assert cells(text, "`y_flat`") == ["constant", "constant"]


def test_the_sentence_on_rank_correlations_tells_the_number_of_runs(many):
    told = sentences_of(results(many), ())[-1]
    assert told.startswith("rank correlation of y with x 1.00, x_noise ")
    assert told.endswith(f", of {sum(not each['failed'] for each in many)} runs")


def test_a_saltelli_design_with_a_failure_has_no_indices(many):
    found = results(many[:96], kind="saltelli", n=24)
    assert "indices need every run" in page(found).partition("Sobol indices: first")[2]
    assert "Fractions and quantiles are those of the first 48 runs" in page(found)


def test_failures_are_grouped_and_set_apart(many):
    text = page(results(many)).partition("## Runs without success")[2]
    assert cells(text, "diverged")[0] == "coast"
    assert float(cells(text, "`x_noise`")[1]) < 1e-6


def test_text_in_a_table_cannot_break_it():
    rows = [row(i, outcome="error", x=1.0 * i) | {"message": "ValueError: a | b"} for i in range(8)]
    assert r"ValueError: a \| b" in page(results(rows))


def test_a_campaign_without_rows_has_a_page():
    assert page(results([], runs=64)) == "# made-up\n\n0 of 64 runs have a result.\n"


def test_an_unfinished_campaign_says_so(many):
    assert "100 of 128 runs, samples of kind `random`, 2 parameters." in page(results(many[:100], runs=128))


@pytest.mark.long
def test_pictures(many, tmp_path):
    texts = [each | {"x_law": "newton" if each["run"] % 2 else "blend"} for each in many]
    made = save_figures(results(texts), [], tmp_path)
    assert [name for _, name in made] == ["metric-y.png", "metric-y_some.png", "convergence.png"]
    before = {name: (tmp_path / name).read_bytes() for _, name in made}
    save_figures(results(texts), [], tmp_path)
    assert {name: (tmp_path / name).read_bytes() for _, name in made} == before


def test_runs_over_each_other(baseline, tmp_path):
    """The tip's way from the log, drawn where the axes say: both ends of it have ink."""
    rerun_runs = [(True, baseline), (False, baseline)]
    made = save_figures(results([row(i, x=1.0 * i) for i in range(4)]), rerun_runs, tmp_path)
    assert made == [("trajectories of repeated runs", "trajectories.png")]
    assert (tmp_path / "trajectories.png").stat().st_size > 20_000


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Eight collisions, one of them made again."""
    folder = tmp_path_factory.mktemp("made")
    success = {"success": "impacts.0.impulse_N_s < 0.9", "metrics": ["impacts.0.impulse_N_s"]}
    found = Campaign.load(rock_hits(folder, **success), folder / "out")
    found.run(loop().open())
    found.rerun(3)
    return found


@pytest.mark.long
def test_the_report_of_a_campaign(made, capsys):
    assert main(["campaign", "report", str(made.folder.path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6
    assert lines[0] == "try: 8 of 8 runs (8 completed)"
    assert lines[1].startswith("success (impacts.0.impulse_N_s < 0.9): ")
    assert lines[4] == "impacts.0.impulse_N_s: no rank correlation (8 runs, 10 are needed)"
    assert lines[5] == f"report: {made.folder.path / 'report.html'}, {made.folder.path / 'report.md'}"
    files = write_report(made)
    assert [file.name for file in files] == [
        *("report.html", "report.md", "metric-impacts_0_impulse_N_s.png", "trajectories.png"),
        *("results.parquet", "results.csv"),
    ]
    assert all(file.is_file() for file in files)
    whole, text = files[0].read_text(), files[1].read_text()
    assert whole.count("data:image/png;base64,") == 2
    assert not re.search(r'(src|href)="(?!data:)', whole)
    assert cells(text, "outcome `completed`")[0] == "8 of 8"
    good = sum(row.metrics["impacts.0.impulse_N_s"] < 0.9 for row in made.rows())
    assert 0 < good < 8
    assert cells(text, "success")[0] == f"{good} of 8"
    for target in re.findall(r"\]\(([^)]+)\)", text):
        assert (files[1].parent / target).is_file()


def test_the_table_for_other_tools_has_every_digit(made):
    write_report(made)
    table = pyarrow.parquet.read_table(made.folder.path / "results.parquet")
    assert table.to_pylist() == made.table_rows()
    lines = (made.folder.path / "results.csv").read_text().splitlines()
    assert lines[0].split(",")[:3] == ['"run"', '"outcome"', '"failed"']
    assert len(lines) == 9


def test_a_page_elsewhere(made, tmp_path):
    files = write_report(made, tmp_path / "docs" / "campaign.md")
    assert files[1].parent == tmp_path / "docs"
    assert (tmp_path / "docs" / "figures" / "campaign" / "trajectories.png").is_file()
    text = files[1].read_text()
    assert "figures/campaign/trajectories.png" in text
    write_report(made, tmp_path / "docs" / "campaign.md")
    assert files[1].read_text() == text


def test_a_replay_that_is_not_whole_is_left_out(made, tmp_path):
    (made.folder.path / "reruns" / "000004").mkdir(exist_ok=True)
    assert "trajectories.png" in [file.name for file in write_report(made, tmp_path / "page.md")]


def test_a_report_that_cannot_be_written(made, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["campaign", "report", str(made.folder.path), "--page", str(tmp_path / "file" / "page.md")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
