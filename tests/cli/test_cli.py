"""The command line as a person uses it: exit codes, messages, files."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.report import plots
from tests.scenes import two_balls


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """Every command runs in an empty folder: shipped names work from any directory."""
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")


def test_run_writes_the_folder_and_links_latest(tmp_path, capsys):
    path = two_balls(tmp_path)
    assert main(["run", str(path), "-s", "duration_s=0.5"]) == 0
    out = capsys.readouterr().out
    assert "scene: completed; 0.5 s simulated" in out
    assert "ball-target/target" in out
    assert "all 15 checks pass; worst: " in out
    assert "FAILED" not in out
    latest = tmp_path / "cwd" / "logs" / "latest"
    assert latest.is_symlink()
    assert {p.name for p in latest.iterdir()} == {"run.mcap", "run.rrd", "scenario.yaml", "summary.json", "mjcf"}
    assert json.loads((latest / "summary.json").read_text())["scenario"] == "scene"
    assert main(["analyze"]) == 0
    assert "all 15 checks pass over 0.5 s (501 samples)" in capsys.readouterr().out


def test_analyze_exits_1_when_a_law_is_violated(tmp_path, capsys):
    assert main(["run", str(two_balls(tmp_path, speed=3.7)), "--no-rerun", "--out", "mine"]) == 0
    assert main(["analyze", "mine", "--tolerance", "1e-30"]) == 1
    assert "FAILED" in capsys.readouterr().out
    assert main(["analyze", "mine/run.mcap", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["complete"] is True
    assert all(check["passes"] for check in report["checks"])


def test_analyze_several_runs(tmp_path, capsys):
    """Each run is verified, one that fails decides the exit code; JSON is a list; a law may have its own tolerance."""
    path = str(two_balls(tmp_path, speed=3.7))
    for name, override in (("a", []), ("b", ["-s", "contacts.rules.0.restitution=0.5"])):
        assert main(["run", path, "--no-rerun", "--out", name, *override]) == 0
    capsys.readouterr()
    assert main(["analyze", "a", "b", "--compare"]) == 0
    out = capsys.readouterr().out
    assert "2 of 2 runs verified" in out
    assert "contacts.rules.0.restitution: 1.0 -> 0.5" in out
    assert "the motions differ from 0.082 s on" in out  # 0.3 m at 3.7 m/s
    assert main(["analyze", "a", "b", "--json"]) == 0
    assert [len(report["checks"]) for report in json.loads(capsys.readouterr().out)] == [15, 15]
    assert main(["analyze", "a", "b", "--tolerance", "impact_restitution=1e-30", "--tolerance", "1e-6"]) == 1
    assert "of 2 runs verified; FAILED in" in capsys.readouterr().out
    for wrong in (["--tolerance", "charm=1e-9"], ["--compare", "--json"]):
        assert main(["analyze", "a", "b", *wrong]) == 2
    assert "unknown check 'charm'; allowed: " in capsys.readouterr().err


@pytest.mark.long
def test_figures_of_several_runs(tmp_path, capsys, monkeypatch):
    """A folder for each run, named apart, and one figure of all; which figures there are is tested in test_plots."""
    every = plots._makers
    monkeypatch.setattr(plots, "_makers", lambda run, _: every(run, ["energies"]))
    assert main(["run", str(two_balls(tmp_path)), "--no-rerun", "--out", "a"]) == 0
    assert main(["analyze", "a", "a/run.mcap", "--plots", "figures"]) == 0
    figures = tmp_path / "cwd" / "figures"
    files = {str(path.relative_to(figures)) for path in figures.rglob("*.*")}
    assert files == {f"{name}.{form}" for name in ("a/energies", "a-2/energies", "comparison") for form in ("svg", "png")}
    assert "figures in figures/a:" in capsys.readouterr().out


def test_export_writes_beside_the_log(tmp_path, capsys):
    assert main(["run", str(two_balls(tmp_path, duration_s=0.1)), "--no-rerun", "--out", "a"]) == 0
    assert main(["export", "a", "--csv"]) == 0
    assert main(["export", "a", "--parquet", "--table", "impacts"]) == 0
    out = capsys.readouterr().out
    assert "a/samples.csv: 101 rows of" in out
    assert "a/impacts.parquet: 0 rows of 47 columns" in out
    assert main(["export", "a", "--csv", "--table", "tables"]) == 2
    assert "unknown table 'tables' (did you mean 'samples'?); allowed: angular_momentum, checks, " in capsys.readouterr().err


def test_a_run_that_fails_exits_3(tmp_path, capsys):
    path = two_balls(tmp_path, impact={"max_impacts": 1})
    assert main(["run", str(path), "--no-rerun", "--out", "mine"]) == 3
    captured = capsys.readouterr()
    assert "event_limit" in captured.err
    assert main(["analyze", "mine"]) == 0


def test_a_run_that_dissipates_is_not_judged(tmp_path, capsys):
    path = two_balls(tmp_path, conservative=False)
    text = (tmp_path / "target.xml").read_text().replace('type="slide"', 'type="slide" damping="2"')
    (tmp_path / "target.xml").write_text(text)
    assert main(["check", str(path)]) == 0
    assert "breaks conservation: " in capsys.readouterr().out
    assert main(["run", str(path), "--no-rerun", "--out", "mine"]) == 0
    assert "not conservative" in capsys.readouterr().out
    assert main(["analyze", "mine"]) == 0
    assert "not checked, the run is not conservative" in capsys.readouterr().out


def test_check_list_schema_version(capsys):
    assert main(["check", "baseline"]) == 0
    assert "conservative: nothing in the models breaks it" in capsys.readouterr().out
    assert main(["run", "--list"]) == 0
    assert "Nekoo, Sharf & Ollero 2024, 4.2" in capsys.readouterr().out
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "ffsm-mj scenario"
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("ffsm-mj ")


@pytest.mark.parametrize("arguments", [["run"], ["run", "nope"], ["analyze", "nope"], ["check", "baseline", "-s", "a=1"]])
def test_bad_input_exits_2_without_a_traceback(arguments, capsys):
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("analyze --tolerance -1", "ffsm analyze: argument --tolerance: -1 is not a positive number"),
        ("analyse", "ffsm: unknown command 'analyse' (did you mean 'analyze'?); allowed: analyze, campaign, check, "),
        ("run --what", "ffsm run: unexpected argument '--what'; see 'ffsm run --help'"),
        ("check baseline twice", "ffsm check: unexpected argument 'twice'; see 'ffsm check --help'"),
        ("export", "ffsm export: one of the arguments --csv --parquet --gif --mp4 --html is required"),
        ("export --csv --gif", "ffsm export: argument --gif: not allowed with argument --csv"),
        ("--version schema", "ffsm: --version has no effect with the command schema"),
        ("run baseline --viewer 127.0.0.1:1", "ffsm run: --viewer has no effect without --live"),
        ("run baseline --force", "ffsm run: --force has no effect without --out"),
        ("run --list baseline", "ffsm run: baseline has no effect with --list"),
        ("run --list -s a=1", "ffsm run: -s has no effect with --list"),
        ("run --list --out a", "ffsm run: --out has no effect with --list"),
        ("run --list --no-rerun", "ffsm run: --no-rerun has no effect with --list"),
        ("run --list --allow-failed-checks", "ffsm run: --allow-failed-checks has no effect with --list"),
        ("run --list --live", "ffsm run: --live has no effect with --list"),
        ("export --csv --fps 5", "ffsm export: --fps has no effect without --gif or --mp4"),
        ("export --parquet --speed 5", "ffsm export: --speed has no effect without --gif or --mp4"),
        ("export --gif --table laws", "ffsm export: --table has no effect without --csv or --parquet"),
        ("analyze --tolerance 1e-9 --tolerance 1e-8", "--tolerance: given twice for all checks"),
        ("analyze --compare", "--compare: name two runs or more"),
        ("analyze a b --compare --json", "--compare prints text: omit --json"),
    ],
)
def test_options_that_are_wrong_or_have_no_effect_are_one_line(arguments, message, capsys):
    assert main(arguments.split()) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(message)
    assert captured.err.count("\n") == 1


def test_a_film_is_of_the_form_that_its_name_says(tmp_path, capsys):
    assert main(["run", str(two_balls(tmp_path, duration_s=0.1)), "--no-rerun", "--out", "a"]) == 0
    for form, name in (("--gif", "a.mp4"), ("--gif", "a"), ("--html", "a.htm"), ("--csv", "a.parquet")):
        assert main(["export", "a", form, "--out", name]) == 2
        assert f"{form} writes .{form[2:]}, but --out {name} has another suffix" in capsys.readouterr().err
    assert main(["export", "a", "--csv", "--out", "a.txt"]) == 0


def python(code: str) -> str:
    """What a fresh interpreter prints."""
    command = [sys.executable, "-c", code]
    environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}  # set for the suite
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


def test_help_imports_nothing_heavy():
    code = """
import sys
from ffsm_mj.cli.main import main
try:
    main(["--help"])
except SystemExit:
    pass
heavy = {"mujoco", "scipy", "rerun", "matplotlib", "pydantic", "numpy", "ruamel", "rich", "google"}
print("heavy:", sorted(heavy & {name.split(".")[0] for name in sys.modules}))
"""
    assert python(code).splitlines()[-1] == "heavy: []"


def test_a_run_imports_no_viewer_unless_it_records(tmp_path):
    path = two_balls(tmp_path, duration_s=0.05)
    code = f"""
import os, sys
from ffsm_mj.cli.main import main
main(["run", {str(path)!r}, "--no-rerun"])
assert os.environ["OPENBLAS_NUM_THREADS"] == "1", "a second BLAS thread only spins"
print("heavy:", sorted({{"rerun", "matplotlib", "rich", "scipy"}} & {{name.split(".")[0] for name in sys.modules}}))
"""
    assert python(code).splitlines()[-1] == "heavy: []"


def test_a_run_whose_step_is_too_long_says_so_last_and_exits_5(capsys):
    """A step of 0.1 s, far too coarse for the spatial robot: its momenta are off by 1e-5."""
    coarse = [f"-s{key}=0.1" for key in ("time_step_s", "control_period_s")]
    arguments = ["run", "spatial", *coarse, "-s", "duration_s=1", "--no-rerun"]
    for allowed, code in (([], 5), (["--allow-failed-checks"], 0)):
        assert main([*arguments, *allowed, "--out", f"run{code}"]) == code
        captured = capsys.readouterr()
        assert captured.err.startswith("checks fail by the truncation of the step alone: ")
        assert "linear momentum of total" in captured.err
        assert "truncation" in captured.out
        assert captured.err.count("\n") == 1
    assert main(["analyze", "run0"]) == 5


def test_a_run_folder_runs_again(tmp_path, capsys):
    assert main(["run", str(two_balls(tmp_path, speed=3.7)), "--no-rerun", "--out", "a"]) == 0
    assert main(["check", "a"]) == 0
    assert main(["run", "a", "--no-rerun", "--out", "b"]) == 0
    capsys.readouterr()
    assert main(["analyze", "a", "b", "--compare"]) == 0
    assert "b against a: identical" in capsys.readouterr().out
    (tmp_path / "cwd" / "none").mkdir()
    assert main(["run", "none"]) == 2
    assert capsys.readouterr().err == "none: is a folder without a scenario.yaml; name a scenario file or a run folder\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["run", "baseline", "--no-rerrun"],
            "ffsm run: unexpected argument '--no-rerrun' (did you mean '--no-rerun'?); see ",
        ),
        (
            ["campaign", "run", "--wrokers", "3"],
            "ffsm campaign run: unexpected argument '--wrokers' (did you mean '--workers'?);",
        ),
        (["run", "a", "b"], "ffsm run: unexpected argument 'b'; see 'ffsm run --help'"),
        (["run", "scenarios/nowhere.yaml"], "scenarios/nowhere.yaml: no such scenario file\n"),
        (["run", "coasting", "-s", "task.tip=x"], "-s task.tip=x: "),
        (["analyze", "logs/latest"], "logs/latest: no such run; run 'ffsm run baseline' first"),
    ],
)
def test_what_is_unknown_is_refused_with_what_was_meant(arguments, said, capsys):
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith(said)


def test_a_folder_that_holds_a_run_is_refused_before_the_scenario_is_read(tmp_path, capsys):
    (tmp_path / "cwd" / "mine").mkdir()
    (tmp_path / "cwd" / "mine" / "run.mcap").touch()
    assert main(["run", "no such scenario", "--out", "mine"]) == 2
    assert capsys.readouterr().err.startswith("mine: already contains a run (run.mcap); choose another --out, or --force")


def test_notes_are_shown_before_the_run(monkeypatch, capsys):
    """Four lines at most, then the command that shows all of them, with the overrides."""
    for count in (4, 5, 7):
        monkeypatch.setattr("ffsm_mj.assembly.notes.notes", lambda _, count=count: [f"number {i}" for i in range(count)])
        assert main(["run", "coasting", "--no-rerun", "-s", "duration_s=0.01", "-s", "model.object.box.mass_kg=7"]) == 0
        head = capsys.readouterr().out.split("coasting: completed")[0].splitlines()
        assert head[:4] == [f"note: number {i}" for i in range(4)]
        more = {4: [], 5: ["and 1 more note: "], 7: ["and 3 more notes: "]}[count]
        assert head[4:] == [f"{text}ffsm check coasting -s duration_s=0.01 -s model.object.box.mass_kg=7" for text in more]


def test_changed_properties_are_part_of_the_description_and_of_the_report(capsys):
    changes = ("-s", "duration_s=0.01", "-s", "model.object.box.mass_kg=7")
    assert main(["check", "coasting", *changes]) == 0
    described = capsys.readouterr().out
    (line,) = [line for line in described.splitlines() if "model.object.box.mass_kg" in line]
    assert line.startswith("    model.object.box.mass_kg is 7; without it ")
    assert main(["run", "coasting", "--no-rerun", *changes]) == 0
    assert "\nmodel.object.box.mass_kg = 7\n" in capsys.readouterr().out
