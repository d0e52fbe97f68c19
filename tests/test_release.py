"""What a release is made of agrees: version, notes, workflows; nothing of the machine it was made on is in any file."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.version import Version
from ruamel.yaml import YAML

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = [path for path in sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")) if path.name != "config.yml"]


def read(path):
    return YAML(typ="safe").load(path.read_text(encoding="utf-8"))


def released():
    """Version and date of each section of the changelog, newest first."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$", text, flags=re.MULTILINE)[0] == "Unreleased"
    return re.findall(r"^## (\d\S*) - (\d{4}-\d\d-\d\d)$", text, flags=re.MULTILINE)


def test_one_version_and_one_date():
    """Of a post-release, which is the same source for another MuJoCo, the section is that of its release."""
    version, date = released()[0]
    cited = read(ROOT / "CITATION.cff")
    assert Version(PROJECT["project"]["version"]).base_version == version
    assert (cited["version"], str(cited["date-released"])) == (version, date)
    assert [Version(was) for was, _ in released()] == sorted((Version(was) for was, _ in released()), reverse=True)


def test_the_notes_of_a_release_are_its_section():
    if not shutil.which("make"):
        pytest.skip("make is missing")
    notes = subprocess.run(
        ["make", "--silent", "-C", ROOT, "release-notes"], capture_output=True, text=True, check=True
    ).stdout
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    section = text.partition(f"\n## {released()[0][0]}")[2].partition("\n## ")[0].partition("\n")[2]
    assert notes.strip() == section.strip()
    assert notes.strip()


def test_build_and_run_want_one_minor_version_of_mujoco():
    """That of the core: `X.Y.Z.postN` changes both."""
    wanted = [
        requirement
        for requirement in PROJECT["project"]["dependencies"] + PROJECT["build-system"]["requires"]
        if requirement.startswith("mujoco>")
    ]
    assert len(wanted) == 2
    assert len(set(wanted)) == 1
    assert re.fullmatch(r"mujoco>=(\d+)\.(\d+),<\1\.\d+", wanted[0])


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_workflows_may_do_little_and_take_actions_by_their_commit(workflow):
    content = read(workflow)
    assert content["permissions"] == {"contents": "read"}
    for job in content["jobs"].values():
        for step in job["steps"]:
            if "uses" in step:
                assert re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", step["uses"])
            else:
                assert "${{" not in step["run"]  # names of branches and tags are no shell


def test_workflows_run_the_checks_of_a_change_and_make_targets_that_exist():
    steps = [step.get("run", "") for path in WORKFLOWS for job in read(path)["jobs"].values() for step in job["steps"]]
    assert ".ci/run" in steps
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = [
        word for step in steps if step.startswith("make ") for word in step.partition(">")[0].split()[1:] if word[0] != "-"
    ]
    assert sorted(targets) == ["docs", "release-notes"]
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE)


@pytest.mark.parametrize("form", FORMS, ids=lambda path: path.name)
def test_issue_forms_ask_for_something(form):
    content = read(form)
    assert content["name"]
    assert content["description"]
    assert any(part.get("validations", {}).get("required") for part in content["body"])


def test_no_file_names_the_machine_it_was_made_on():
    """Folders of users and of this machine, and addresses of package indexes, which differ from place to place."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    pages = [
        ROOT / name for name in listed.split("\0") if re.search(r"\.(md|toml|yml|yaml|ipynb|cff|txt)$|^Makefile$", name)
    ]
    assert len(pages) > 100
    for page in pages:
        found = re.search(
            r"/(?:home|Users|root)/|(?:index-url|extra-index)|https?://(?:pypi|files)\.",
            page.read_text(encoding="utf-8"),
        )
        assert not found, f"{page.relative_to(ROOT)}: {found and found[0]}"
