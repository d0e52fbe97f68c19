"""What every command prints on a terminal: whole words, in colour to the end of a row, and nothing in the wrong number."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from ffsm_mj.cli.main import main
from tests.contact_models.grasp.scenes import grasping
from tests.terminal import ffsm, on_terminal

CAMPAIGN = """campaign: c
scenario: {scenario}
samples: {{kind: random, n: 1, seed: 3}}
dispersions: {{initial.rates.robot/stroke: {{offset: {{normal: {{sd: 0.01}}}}}}}}
overrides: {{duration_s: 0.3}}
"""
COMMANDS = {
    "run": ("run", "{caught}", "--no-rerun", "--out", "again", "--force"),
    "run-failing": ("run", "{soft}", "--no-rerun", "--out", "failing", "--force", "--truncation", "0"),
    "run-list": ("run", "--list"),
    "check": ("check", "gripper-2f85"),
    "check-orbit": ("check", "capture-orbit"),
    "check-campaign": ("check", "laws-after-impact"),
    "analyze": ("analyze", "bounces"),
    "analyze-compare": ("analyze", "caught", "bounces", "--compare"),
    "analyze-failing": ("analyze", "caught", "--tolerance", "1e-20", "--truncation", "0"),
    "export": ("export", "caught", "--csv"),
    "campaign": ("campaign", "run", "{campaign}", "--workers", "1"),
    "campaign-list": ("campaign", "run", "--list"),
    "sensitivity": ("sensitivity", "tap", "-s", "duration_s=0.3", "--wrt", "contacts.rules.0.restitution=0.01"),
    "validate": ("validate", "newtons-cradle"),
    "new-law": ("new-law", "law_of_mine", "--out", "a/long/name/of/a/folder/with/a/law/in/it"),
    "help": ("--help",),
    **{f"help-{name}": (name, "--help") for name in ("run", "new", "export", "impact-map", "validate", "fit")},
    "wrong": ("run", "basline"),
}
"""Commands; ``{name}`` is a file, other names those of the shipped scenarios and of runs in the folder."""


@dataclass(frozen=True)
class Place:
    """Where the commands run, and their files."""

    folder: Path
    files: dict[str, Path]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Runs of a capture and of bounces; a scenario whose steps are too long for its checks; a campaign of one run."""
    folder = tmp_path_factory.mktemp("outputs")
    caught = grasping(folder / "caught_scene")
    campaign = folder / "c.yaml"
    campaign.write_text(CAMPAIGN.format(scenario="tap"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["run", str(caught), "--no-rerun", "--out", "caught"]) == 0
        assert main(["run", "tap", "-s", "duration_s=3", "--no-rerun", "--out", "bounces"]) == 0
    soft = grasping(folder / "soft_scene", time_step_s=0.05, control_period_s=0.05)
    return Place(folder, {"caught": caught, "campaign": campaign, "soft": soft})


def lines_of(written: str) -> list[str]:
    """Lines as they were written, without colours, and without what was painted over."""
    painted = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", written)
    return [line.rpartition("\r")[2] for line in painted.replace("\r\n", "\n").split("\n")]


SEVERAL_OF_ONE = re.compile(r"(?<![\d.,/x-])(?<![\d.,/x-] )\b1 (?!as\b|is\b|has\b|differs\b|does\b|changes\b)[a-z]{3,}s\b")
"""A plural of one; not of a numbered thing that does something, as ``impact 1 differs``."""


@pytest.mark.long(by_turns=True)
@pytest.mark.parametrize("columns", [60, 80, 120])
@pytest.mark.parametrize("name", COMMANDS)
def test_outputs_of_commands_on_terminals(place, monkeypatch, name, columns):
    """No line is broken by the terminal within a word, and one of a thing is not several."""
    monkeypatch.chdir(place.folder)
    words = [word.format(**place.files) if "{" in word else word for word in COMMANDS[name]]
    shown = on_terminal(ffsm(*words), columns=columns)
    assert "Traceback" not in shown.written
    assert len("".join(shown.screen)) > 20
    for line in lines_of(shown.written):
        # A word that is longer than the terminal cannot be kept whole.
        assert len(line) <= columns or " " not in line.strip(), line
        assert not SEVERAL_OF_ONE.search(line), line
        assert "FFSM" not in line
