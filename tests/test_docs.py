"""What the documentation says, run as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import ffsm_mj
from tests.scenes import two_balls

ROOT = Path(__file__).parent.parent


def python_blocks(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)


def test_single_collision_of_the_user_guide(capsys):
    code = next(block for block in python_blocks("docs/user-guide.md") if "resolve" in block)
    promised = re.search(r"\)  # (.*)$", code, flags=re.MULTILINE).group(1)
    exec(code, {})
    assert capsys.readouterr().out.strip() == promised


def test_reading_the_log_as_the_user_guide_does(tmp_path, capsys, monkeypatch):
    ffsm_mj.run(two_balls(tmp_path, duration_s=0.01), out=tmp_path / "logs" / "latest", rerun=False)
    monkeypatch.chdir(tmp_path)
    exec(next(block for block in python_blocks("docs/user-guide.md") if "make_reader" in block), {})
    assert len(capsys.readouterr().out.splitlines()) == 11


@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        "docs/user-guide.md",
        "docs/derivations.md",
        "docs/own-controller.md",
        "docs/own-robot.md",
        "docs/performance.md",
    ],
)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / page).read_text()):
        assert target.startswith("http") or (ROOT / page).parent.joinpath(target).exists(), target
