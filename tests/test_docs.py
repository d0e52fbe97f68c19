"""What the documentation says, run as it stands."""

from __future__ import annotations

import pkgutil
import re
import runpy
from pathlib import Path

import pytest

import ffsm_mj
from ffsm_mj.cli.main import main
from tests.scenes import two_balls

ROOT = Path(__file__).parent.parent


def python_blocks(page):
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)


@pytest.mark.long
@pytest.mark.parametrize("word", ["resolve", "Scenario.load", "animate"])
def test_what_the_code_of_the_page_prints(capsys, tmp_path, monkeypatch, word):
    monkeypatch.chdir(tmp_path)
    code = next(block for block in python_blocks("docs/python.md") if word in block)
    promised = re.search(r"\)  # (.*)$", code, flags=re.MULTILINE).group(1)
    exec(code, {})
    assert capsys.readouterr().out.strip() == promised


def test_reading_the_log_as_the_page_does(tmp_path, capsys, monkeypatch):
    ffsm_mj.run(two_balls(tmp_path, duration_s=0.01), out=tmp_path / "logs" / "latest", rerun=False)
    monkeypatch.chdir(tmp_path)
    exec(next(block for block in python_blocks("docs/python.md") if "make_reader" in block), {})
    assert len(capsys.readouterr().out.splitlines()) == 11


def fenced(page, kind):
    return re.findall(rf"```{kind}\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)


def masked(text):
    """Without what rounding decides: residuals, and where and when they are worst."""
    text = re.sub(r"(worst difference:\n).*", r"\1", text)
    text = re.sub(r"-?\d(\.\d+)?e[-+]\d\d", "#", text)
    text = re.sub(r"(T|[PL]_[xyz]|gap)( at)? +\d+\.\d{3}", "@", text)
    return [re.sub(" +", " ", line) for line in text.strip().splitlines()]


@pytest.fixture
def latest(baseline_folder, tmp_path, monkeypatch):
    """A folder in which ``logs/latest`` is the baseline."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "latest").symlink_to(baseline_folder, target_is_directory=True)
    monkeypatch.chdir(tmp_path)


@pytest.mark.long
@pytest.mark.usefixtures("latest")
def test_the_verification_is_what_the_command_prints(capsys):
    assert main(["analyze"]) == 0
    promised, printed = fenced("docs/verified-result.md", "text")[0], capsys.readouterr().out
    assert masked(promised)[1:] == masked(printed)[3:]  # the first line tells the wall time


@pytest.mark.long
def test_the_first_command_prints_what_the_readme_says(tmp_path, capsys):
    assert main(["run", "baseline", "--no-rerun", "--out", str(tmp_path / "run")]) == 0
    promised, printed = fenced("README.md", "")[1], capsys.readouterr().out
    first = printed.index("baseline: completed")
    texts = [re.sub(r"in \d.*real time", "in # s", text) for text in (promised, printed[first:])]
    assert masked(texts[1])[: len(masked(texts[0]))] == masked(texts[0])


@pytest.mark.usefixtures("latest")
def test_arrays_of_the_verified_result(capsys):
    code = next(block for block in python_blocks("docs/verified-result.md") if "load_run" in block)
    exec(code, {})
    assert [f"# {line}" for line in capsys.readouterr().out.splitlines()] == code.splitlines()[-2:]


def test_tests_of_the_verified_result(baseline):
    """The page's tests on the session's baseline: one passes, one fails as promised."""
    names = {}
    exec(next(block for block in python_blocks("docs/verified-result.md") if "assert_conserved" in block), names)
    names["test_the_hit"](lambda _: baseline)
    with pytest.raises(AssertionError) as caught:
        names["test_energy_to_twelve_digits"](lambda _: baseline)
    promised = fenced("docs/verified-result.md", "text")[1]
    assert masked(promised) == masked(f"AssertionError: {caught.value}")


def test_impacts_and_frames_as_the_page_reads_them(tmp_path, capsys, monkeypatch):
    ffsm_mj.run(two_balls(tmp_path, duration_s=0.4), out=tmp_path / "logs" / "latest", rerun=False)
    monkeypatch.chdir(tmp_path)
    exec(next(block for block in python_blocks("docs/python.md") if "/ffsm/impact" in block), {})
    impact, robot, target, *frames = capsys.readouterr().out.splitlines()
    assert impact == "0.300 s: 2.4000 N s"
    assert target.startswith("target/x from 0.0 to 0.8")
    assert robot.startswith("robot/x from 1.0 to -0.2")
    assert len(frames) == 21
    assert frames[-1] == "0.4 robot/ball 0.28"


def test_the_log_reference_is_current():
    """``make reference`` writes it."""
    made = "\n".join(runpy.run_path(str(ROOT / "docs" / "log_reference.py"))["reference"]())
    assert made == (ROOT / "docs" / "log-reference.md").read_text()


SITE = runpy.run_path(str(ROOT / "docs" / "site_hooks.py"))


def test_the_user_guide_lists_every_page_once():
    """The navigation of the site and llms.txt are made of it."""
    listed = sorted(file for entries in SITE["index"]().values() for _, file, _ in entries)
    pages = [path for kind in ("*.md", "notebooks/*.ipynb") for path in (ROOT / "docs").glob(kind)]
    assert listed == sorted(path.relative_to(ROOT / "docs").as_posix() for path in pages if path.name != "user-guide.md")


def test_llms_txt_is_current():
    """``make llms`` writes it."""
    assert SITE["llms_txt"]() == (ROOT / "llms.txt").read_text(encoding="utf-8")


def test_the_reference_has_every_public_name():
    documented = [name for _, *names in SITE["API"].values() for name in names]
    for name in documented:
        pkgutil.resolve_name(name)
    modules = {module.removeprefix("ffsm_mj."): names for module, names in ffsm_mj._NAMES.items()}
    for module, names in modules.items():
        missing = [name for name in names if not {f"ffsm_mj.{module}", f"ffsm_mj.{module}.{name}"} & {*documented}]
        assert not missing, f"{module}: {missing}"


def test_the_gallery_shows_every_scenario(monkeypatch):
    """``make gallery`` writes the page and draws the pictures."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    gallery = runpy.run_path(str(ROOT / "docs" / "gallery.py"))
    assert gallery["text"]() == (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert sorted(path.stem for path in gallery["PICTURES"].glob("*.png")) == list(gallery["scenario_names"]())


PAGES = ["README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs").glob("*.md"))]


def anchors(page):
    """Anchors of the headings of a page, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL), flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^) ]+)\)", (ROOT / page).read_text()):
        if target.startswith(("http", "mailto:")):
            continue
        name, _, anchor = target.partition("#")
        leads_to = (ROOT / page).parent / name if name else ROOT / page
        assert leads_to.exists(), target
        assert not anchor or leads_to.suffix != ".md" or anchor in anchors(leads_to), target


@pytest.mark.parametrize("page", ["docs/architecture.md", "docs/how-a-step-works.md"])
def test_files_named_by_the_pages_on_the_code_exist(page):
    for name in re.findall(r"`(?:ffsm_mj/)?([\w/]+/\w+\.pyx?)", (ROOT / page).read_text()):
        assert (ROOT / "ffsm_mj" / name).exists() or (ROOT / name).exists(), name


def test_names_in_the_architecture_exist():
    """``analysis.run.Run``: a name in a package of ``ffsm_mj``."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    names = [name for name in re.findall(r"`([a-z]\w*(?:\.\w+)+)`", text) if not re.search(r"\.(pyx?|toml|json)$", name)]
    assert len(names) > 5
    for name in names:
        pkgutil.resolve_name(f"ffsm_mj.{name}")


def test_functions_in_the_lists_of_calls_are_in_their_files():
    """``2. `cli/run.py`: `run` ``, and of a class ``Driver.drive``."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    lines = re.findall(r"^\d+\. `([\w/]+\.py)`(.*)$", text, flags=re.MULTILINE)
    assert len(lines) > 12
    for file, rest in lines:
        source = (ROOT / "ffsm_mj" / file).read_text()
        for name in re.findall(r"`([\w.]+)`", rest.partition(":")[2].partition(" of `")[0]):
            for part in name.split("."):
                assert re.search(rf"^ *(def|class) {part}\b", source, flags=re.MULTILINE), (file, name)


def test_pages_install_from_a_checkout():
    """ffsm-mj is on no package index: no page, and no message, may send people there."""
    pages = [
        ROOT / "README.md",
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "ffsm_mj").rglob("*.py"),
    ]
    for page in pages:
        assert not re.search(r"(pip install|uv add|uvx|pipx)\b[^\n]*ffsm-mj", page.read_text(encoding="utf-8")), page
