"""The page on campaigns: its files are read as they stand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ffsm_mj.experiments.file import CampaignFile, KeepConfig, LimitsConfig, SamplesConfig, StopConfig
from ffsm_mj.experiments.planning import load_campaign
from ffsm_mj.yaml import plain_value
from tests.experiments.files import campaign_file, two_rocks
from tests.scenes import HEAD

PAGE = (Path(__file__).parents[2] / "docs" / "campaigns.md").read_text()
BLOCKS = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)


def test_the_first_file_is_valid(tmp_path):
    (tmp_path / "C.yaml").write_text(BLOCKS[0])
    assert len(load_campaign(tmp_path / "C.yaml").design().rows) == 64


@pytest.mark.parametrize("block", [block for block in BLOCKS if block.startswith("dispersions:")])
def test_dispersions_of_the_page(tmp_path, block):
    dispersions = plain_value(block)["dispersions"]
    if any(key.startswith("initial.joints.rock") for key in dispersions):
        (tmp_path / "wall.xml").write_text(f"<mujoco>{HEAD}<worldbody><geom size='1'/></worldbody></mujoco>")
        wall = {"mjcf": "wall.xml", "fixed": True, "pose": {"position_m": [50, 0, 0]}}
        two_rocks(tmp_path)
        path = campaign_file(tmp_path, dispersions, overrides={"objects.wall": wall})
    else:
        path = campaign_file(tmp_path, dispersions, scenario="baseline")
    load_campaign(path).design()


def test_the_table_of_keys_is_that_of_the_file():
    table = PAGE.partition("## Keys\n")[2].partition("\n## ")[0]
    named = [
        name for line in table.splitlines() for name in re.findall(r"`(\w+)`", line.split("|")[1] if "|" in line else "")
    ]
    assert named == list(dict.fromkeys(named))
    assert set(named) == set(CampaignFile.model_fields)
    for key, config in (("samples", SamplesConfig), ("keep", KeepConfig), ("limits", LimitsConfig), ("stop", StopConfig)):
        told = next(line for line in table.splitlines() if line.startswith(f"| `{key}`"))
        assert set(config.model_fields) <= set(re.findall(r"\w+", told))
