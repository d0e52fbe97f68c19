"""A folder of traps, named like modules that commands import: whatever is done in it, none is executed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ffsm_mj.experiments.executors import importable

PUBLIC = [name for name in sorted(sys.stdlib_module_names) if not name.startswith("_")]
TRAPS = [
    *("ctypes", "multiprocessing", "subprocess", "json", "typing", "pathlib", "signal", "logging", "sitecustomize"),
    *("numpy", "mujoco", "scipy", "rerun", "pydantic", "ruamel", "mcap", "google", "pyarrow", "ffsm_mj", "ffsm_controllers"),
    *PUBLIC[:: max(1, len(PUBLIC) // 50)][:50],
]
FFSM = [sys.executable, "-P", "-m", "ffsm_mj"]
COMMANDS = {
    "analyze": ["analyze", "run"],
    "resume": ["campaign", "resume", "campaign", "--workers", "1"],
    "run": ["run", "coasting", "-s", "duration_s=0.02", "--out", "another"],
    "again": ["run", "run", "--no-rerun", "--out", "once_more"],
    "check": ["check", "coasting"],
    "export": ["export", "run", "--csv"],
    "schema": ["schema"],
    "status": ["campaign", "status", "campaign"],
    "report": ["campaign", "report", "campaign"],
    "rerun": ["campaign", "rerun", "campaign", "0"],
    "new": ["new-law", "my_brake"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A run, a campaign of which a run is left to do, and at least 60 traps."""
    home = tmp_path_factory.mktemp("traps")
    for words in (
        ("run", "coasting", "-s", "duration_s=0.02", "--no-rerun", "--out", "run"),
        (
            *("campaign", "run", "baseline-dispersed", "-s", "samples.n=1", "-s", "overrides.duration_s=0.05", "--out"),
            "campaign",
        ),
    ):
        subprocess.run([*FFSM, *words], cwd=home, check=True, capture_output=True)
    for name in {*TRAPS}:
        (home / f"{name}.py").write_text(f"open({str(home / 'sprung')!r}, 'a').write({name!r} + ' ')\n")
    assert len(list(home.glob("*.py"))) >= 60
    return home


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_no_trap_springs(folder, words):
    done = subprocess.run([*FFSM, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not (folder / "sprung").exists(), (folder / "sprung").read_text()


@pytest.mark.long
def test_workers_of_a_script_import_nothing_from_the_current_folder(folder):
    """``python -c`` has the current folder first on its own path, and only its workers are ours."""
    script = (
        "import sys; here = sys.path.pop(0); assert here == ''; import ffsm_mj; from multiprocessing import active_children;"
        "from ffsm_mj.experiments.executors import Processes; sys.path.insert(0, '')\n"
        "with Processes(1) as pool: print(pool.submit(abs, -7).result())"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False)
    assert done.stdout == "7\n", done.stderr
    # The import of mujoco itself starts a process of its own, before anything of ours is asked.
    (folder / "sprung").unlink(missing_ok=True)


def test_a_law_of_the_current_folder_stays_in_its_process(tmp_path, monkeypatch):
    (tmp_path / "law_of_mine.py").write_text("class Law: pass\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend("")
    from law_of_mine import Law  # type: ignore[import-not-found]

    assert not importable(Law)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert importable(Law)
    assert importable(Path)
