"""Folders of campaigns that somebody else has made: refused in one line, nothing written outside, nothing without end."""

from __future__ import annotations

import json
import shutil
import sqlite3
from pathlib import Path

import pytest

from ffsm_mj.cli.main import main
from ffsm_mj.experiments.folder import CampaignFolder, Record
from ffsm_mj.experiments.planning import load_campaign
from ffsm_mj.experiments.store import RunRow, Store
from tests.experiments.files import rock_hits

_METRICS = {"checks_pass": True, "duration_s": 0.05}
_ENDLESS = (
    "CREATE VIEW rows AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT i, 'completed' outcome,"
    " '' message, '' phase, 0 failed, '{}' metrics, '{}' model, '' cpu, 0.0 wall_s, 0.0 cpu_s FROM n"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A campaign of four runs, whose rows are made up."""
    base = tmp_path_factory.mktemp("made")
    plan = load_campaign(rock_hits(base, samples={"kind": "random", "n": 4, "seed": 1}))
    folder = CampaignFolder(base / "D")
    with folder.locked():
        folder.write_runs(plan.base.scenario_yaml, plan.base.system.logged_files, plan.design())
        folder.write_record(plan.config, Record(), "")
    store = Store(folder.table)
    store.begin("{}")
    store.add([RunRow(i, "completed", metrics=_METRICS) for i in range(4)])
    store.close()
    return folder.path


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    """A copy of it."""
    shutil.copytree(made, tmp_path / "D")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "D"


def edit(folder, *statements):
    db = sqlite3.connect(folder / "rows.sqlite")
    with db:
        for statement in statements:
            db.execute(statement)
    db.close()


def refused(capsys, *arguments):
    """The only line that a command says."""
    assert main(["campaign", *arguments]) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    return line


@pytest.mark.usefixtures("folder")
def test_as_it_was_made_it_is_read(capsys):
    assert main(["campaign", "status", "D"]) == 0
    assert main(["campaign", "report", "D"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "statements",
    [
        ("DROP TABLE rows", _ENDLESS),
        ("CREATE VIEW v AS SELECT 1",),
        ("CREATE TRIGGER t AFTER INSERT ON rows BEGIN DELETE FROM rows; END",),
        ("CREATE INDEX x ON rows (outcome)",),
        ("ALTER TABLE rows ADD COLUMN more TEXT",),
    ],
)
@pytest.mark.parametrize("action", ["status", "resume"])
def test_a_database_with_more_than_the_two_tables(folder, capsys, statements, action):
    edit(folder, *statements)
    line = refused(capsys, action, "D")
    assert line.startswith("D/rows.sqlite: is not a table of a campaign (")
    assert line.endswith(" does not belong to a campaign)")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("metrics = '{'", "4: Invalid JSON: EOF"),
        ("metrics = '[]'", "4: Input should be a valid dictionary"),
        ("metrics = '{\"a\": 1' || replace(hex(zeroblob(200)), '0', '0') || '}'", "4.a."),
        (f"model = replace(hex(zeroblob({50_000})), '0', '[')", "5: Invalid JSON: recursion limit"),
        ("wall_s = 'long'", "7: Input should be a valid number"),
        ("message = CAST(x'ff' AS TEXT)", "Could not decode to UTF-8"),
        ("i = 7", "has a row of run 7, which is not in the design"),
    ],
)
def test_a_row_that_no_run_leaves(folder, capsys, change, reason):
    edit(folder, f"UPDATE rows SET {change} WHERE i = 2")
    line = refused(capsys, "report", "D")
    assert line.startswith("D/rows.sqlite: ")
    assert reason in line


@pytest.mark.parametrize("page", [2, 3])
def test_damaged_pages(folder, capsys, page):
    file = folder / "rows.sqlite"
    data = bytearray(file.read_bytes())
    size = int.from_bytes(data[16:18], "big")
    data[(page - 1) * size : (page - 1) * size + 64] = b"\x05" * 64
    file.write_bytes(data)
    assert refused(capsys, "status", "D").startswith("D/rows.sqlite: is not a table of a campaign (")


def test_a_journal_that_names_a_file_to_delete(folder, capsys):
    precious = folder.parent / "precious"
    precious.write_text("mine")
    name = str(precious).encode()
    head = bytes.fromhex("d9d505f920a163d7") + bytes(504)
    tail = bytes(4) + name + len(name).to_bytes(4, "big") + sum(name).to_bytes(4, "big") + head[:8]
    (folder / "rows.sqlite-journal").write_bytes(head + tail)
    assert "names another file" in refused(capsys, "status", "D")
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("name", ["rows.sqlite", "rows.sqlite-journal", "driver.lock", "reruns", "scenario"])
def test_nothing_is_written_through_a_link(folder, capsys, name):
    elsewhere = folder.parent / "elsewhere"
    if (folder / name).exists():
        (folder / name).rename(elsewhere)
    else:
        elsewhere.mkdir()
    (folder / name).symlink_to(elsewhere)
    before = sorted(elsewhere.iterdir()) if elsewhere.is_dir() else elsewhere.read_bytes()
    assert "is a symbolic link; nothing is written through it" in refused(capsys, "resume", "D")
    assert (sorted(elsewhere.iterdir()) if elsewhere.is_dir() else elsewhere.read_bytes()) == before


@pytest.mark.parametrize("name", ["report.md", "results.csv", "results.parquet", "figures", "figures/report"])
def test_a_report_follows_no_link(folder, capsys, name):
    elsewhere = folder.parent / "elsewhere"
    is_folder = name.startswith("figures")
    if is_folder:
        elsewhere.mkdir()
    else:
        elsewhere.write_text("mine")
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).symlink_to(elsewhere)
    assert main(["campaign", "report", "D"]) == (2 if is_folder else 0), capsys.readouterr().err
    assert sorted(elsewhere.iterdir()) == [] if is_folder else elsewhere.read_text() == "mine"
    assert (folder / name).is_symlink() == is_folder


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("kind", "x"),
        ("kind", None),
        ("seed", "1"),
        ("n", -3),
        ("parameters", [1]),
        ("rows", [[1.0, 2.0, 3.0]]),
        ("rows", [[[1.0]]]),
        ("rows", 3),
        ("bindings", [{"key": 1, "base": 0, "effects": []}]),
        ("bindings", [{"key": "a", "base": 0, "effects": [{"operation": "value", "columns": [9]}]}]),
    ],
)
def test_a_design_that_is_none(folder, capsys, key, value):
    file = folder / "design.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {key: value}))
    assert refused(capsys, "status", "D").startswith("D/design.json: not a design of a campaign (")


@pytest.mark.parametrize("content", ["", "[]", "{}", "[" * 100_000, '{"scenario": "[", "a": 1}'])
def test_settings_that_are_none(folder, capsys, content):
    db = sqlite3.connect(folder / "rows.sqlite")
    with db:
        db.execute("UPDATE settings SET content = ?", (content,))
    db.close()
    assert refused(capsys, "resume", "D") == "D: its rows were made with other settings: the stored settings cannot be read"


def test_control_characters_of_a_row_stay_off_the_terminal(folder, capsys):
    evil = "\x1b]0;owned\x07\u202e\nrun 3: all is well\r"
    edit(folder, "DELETE FROM rows WHERE i = 1")
    store = Store(folder / "rows.sqlite")
    store.add([RunRow(1, "diverged", message=evil)])
    store.close()
    assert main(["campaign", "status", "D"]) == 0
    captured = capsys.readouterr()
    assert captured.out.replace("\n", "").isprintable()
    assert captured.out.count("\n") == 2
    assert Path("D").is_dir()


def test_words_of_a_row_are_no_markup_in_the_report(folder, capsys):
    edit(folder, "DELETE FROM rows WHERE i = 1")
    store = Store(folder / "rows.sqlite")
    store.add([RunRow(1, "diverged", message="<script>x</script> | y\n# title", phase="<b>")])
    store.close()
    assert main(["campaign", "report", "D"]) == 0, capsys.readouterr().err
    page = (folder / "report.md").read_text()
    assert "<script>" not in page
    assert "<b>" not in page
    assert "\n# title" not in page
    assert r"&lt;script&gt;x&lt;/script&gt; \| y\n# title" in page
