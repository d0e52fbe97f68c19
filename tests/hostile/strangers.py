"""Series of possibly hostile files (logs, run folders with links, robot files, campaign folders) for every command.

Unknown words on the command line, and folders for ``validate`` and ``new-law``, are cases of this series too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from random import Random
from typing import Any

from mcap.records import Attachment, Channel, Message, Metadata

from tests.hostile.campaigns import EVIL, Files, campaign_file_case, campaign_folder_case
from tests.hostile.cases import Case, Command, commands
from tests.hostile.documents import text, tree_of
from tests.hostile.log_mutations import log, mutate_log, records
from tests.hostile.robots import meshes, robot
from tests.hostile.yaml_mutations import mutate_tree, value

STRANGERS = 27
"""The seed of the series."""

_TABLES = ("samples", "impacts", "phases", "checks", "contacts", "grasps", "x", EVIL.replace("\0", ""))
_LOG_WEIGHTS = (5, 5, 1, 1)
"""The later ones, with a capture and with friction, take ten times as long."""
_EXPORTED = {"--csv": "samples.csv", "--parquet": "samples.parquet", "--gif": "motion.gif", "--mp4": "motion.mp4"}
_TARGETS = ("outside/precious", "outside/folder", "outside/folder/new", "outside/new", "outside/log.mcap")


def drawn(number: int, logs: tuple[bytes, ...], campaign: Files, scene: Files) -> Case:
    """A case of the series; logs, the folder of a campaign and the scene of one are there to be mutated."""
    rng = Random(f"{STRANGERS}:{number}")
    kinds, weights = zip(*_KINDS, strict=True)
    kind = rng.choices(kinds, weights)[0]
    if kind == "folder":
        return campaign_folder_case(rng, campaign)
    return campaign_file_case(rng, scene) if kind == "file" else kind(rng, logs)


def _odd_log(rng: Random, data: bytes) -> bytes:
    """A log with mutations of every kind, or with names that want to be more than names."""
    if rng.random() < 0.65:
        return mutate_log(rng, data)
    found = records(data)
    for _ in range(rng.choice((1, 2, 4))):
        rng.choice(_NAMES)(rng, found)
    return log(found)


def _fact(rng: Random, found: list[Any]) -> None:
    """A fact, a topic's or a signal's: what is told of a channel or in metadata."""
    places = [i for i, each in enumerate(found) if isinstance(each, Channel | Metadata) and each.metadata]
    i = rng.choice(places)
    told = dict(found[i].metadata)
    for key in rng.sample(sorted(told), min(len(told), rng.choice((1, 1, 5)))):
        told[key] = rng.choice((EVIL, "", "nan", "-1", "1e308", "None", value(rng), told[rng.choice(sorted(told))]))
    found[i] = replace(found[i], metadata=told)


def _topic(rng: Random, found: list[Any]) -> None:
    i = rng.choice([i for i, each in enumerate(found) if isinstance(each, Channel)])
    found[i] = replace(found[i], topic=rng.choice((f"/ffsm/{EVIL}", EVIL, "/ffsm/x", "")))


def _letters(rng: Random, found: list[Any]) -> None:
    """Letters of a record's text (names, messages) replaced by others of the same length: its lengths still hold."""
    i = rng.choice([i for i, each in enumerate(found) if isinstance(each, Message) and len(each.data) < 4000])
    data, odd = bytearray(found[i].data), EVIL.replace("\0", "").encode()
    words = [k for k in range(len(data) - 4) if data[k : k + 4].isalpha()]
    if words:
        at = rng.choice(words)
        data[at : at + 4] = rng.choice((odd[:4], b"$a$ ", b"$$$$", b"\x1b[2J", b"\xe2\x80\xaex", b"\xff\xff\xff\xff"))[:4]
        found[i] = replace(found[i], data=bytes(data))


def _model_name(rng: Random, found: list[Any]) -> None:
    """A name in the models and the scenario that the log carries, everywhere."""
    old = rng.choice((b"object", b"joint_1", b"gripper", b"base", b"box", b"robot", b"ball"))
    new = rng.choice((b"$a$", b"$x${y}$$", "\u202e".encode(), b"&#27;[31m", b"</script><b>", b"a|b`c"))
    for i, each in enumerate(found):
        if isinstance(each, Attachment):
            found[i] = replace(each, data=each.data.replace(old, new))


_NAMES = (_fact, _fact, _topic, _letters, _letters, _model_name)


def _log_case(rng: Random, logs: tuple[bytes, ...]) -> Case:
    """A log, or a run folder whose other names lead elsewhere: what a command writes there by itself is known."""
    first, second = (rng.choices(logs, _LOG_WEIGHTS)[0] for _ in range(2))
    folder = rng.random() < 0.4
    place = "run" if folder else "run.mcap"
    files = {"run/run.mcap" if folder else "run.mcap": _odd_log(rng, first), "other.mcap": second}
    command: Command = rng.choice(_LOG_COMMANDS)(rng, place)
    links = []
    if folder and rng.random() < 0.5:
        named = [_EXPORTED.get(word, "run.html") for word in command if word.startswith("--")] or ["run.rrd"]
        links = [(f"run/{rng.choice((*named, *named, 'run.rrd', 'summary.json'))}", f"../../{rng.choice(_TARGETS)}")]
    if rng.random() < 0.15:
        links.append((rng.choice(("figures", "x.csv", "x.html")), f"../{rng.choice(_TARGETS)}"))
    if rng.random() < 0.05 and "--mp4" not in command:
        files = {name: content for name, content in files.items() if name != "run/run.mcap"}
        links.append(("run/run.mcap", rng.choice(("../../outside/log.mcap", "run.mcap", "/dev/zero", "../other.mcap"))))
    return Case(f"log: {' '.join(w for w in command[:3] if 'run' not in w)}", files, (command,), links=tuple(links))


def _analyze(rng: Random, place: str) -> Command:
    several = rng.choice(((), (), ("other.mcap", "--compare"), ("other.mcap",)))
    more: tuple[str, ...] = ("--json",) if rng.random() < 0.3 and "--compare" not in several else ()
    plots: tuple[str, ...] = ("--plots", "figures") if rng.random() < 0.02 else ()
    return ("analyze", place, *several, *more, *plots)


def _export_table(rng: Random, place: str) -> Command:
    out = ("--out", rng.choice(("x.csv", "x", "", ".", "folder/x.csv", "x.parquet"))) if rng.random() < 0.2 else ()
    return ("export", place, rng.choice(("--csv", "--parquet")), "--table", rng.choice(_TABLES), *out)


def _export_picture(rng: Random, place: str) -> Command:
    form = rng.choice(("--gif", "--gif", "--html", "--html", "--mp4"))
    rate = (
        ()
        if form == "--html"
        else ("--fps", rng.choice(("1", "1", "50")), "--speed", rng.choice(("1", "1", "1e-9", "1e300")))
    )
    return ("export", place, form, *rate)


def _view(_: Random, place: str) -> Command:
    return ("view", place)


_LOG_COMMANDS: tuple[Callable[[Random, str], Command], ...] = (
    *[_analyze] * 10,
    *[_export_table] * 7,
    *[_export_picture] * 2,
    *[_view] * 2,
)


def _new_case(rng: Random, _: Any) -> Case:
    """A scenario around a robot's file; what is written passes ``check``, and ``run`` takes it."""
    name, content = robot(rng)
    options = ("--base-mass", rng.choice(("1", "1e300", "-1", "x", "1e-12"))) if rng.random() < 0.15 else ()
    options += ("--tip", rng.choice(("tip", "hand", "x", "", EVIL.replace("\0", "")))) if rng.random() < 0.15 else ()
    options += ("--root", rng.choice(("foot", "x", "\x1b[2J"))) if rng.random() < 0.05 else ()
    options += ("--package-path", rng.choice((".", "vendor", "x", "/"))) if rng.random() < 0.2 else ()
    odd = ("q.yaml", "../q", "", "a b", EVIL.replace("\0", ""), "x" * 300)
    wanted = rng.choice(odd) if rng.random() < 0.15 else "q"
    links = [(f"o/{rng.choice(('q.yaml', 'q.xml', 'q_ball.xml'))}", "../../outside/new")] if rng.random() < 0.1 else []
    made: Command = ("new", wanted, "--robot", name, "--out", rng.choice(("o",) * 8 + (".", "robot.urdf/x")), *options)
    short = ("-s", "duration_s=0.02", "--no-rerun", "--out", "run")
    then: tuple[Command, ...] = (
        () if wanted != "q" or made[5] != "o" else (("check", "o/q.yaml"), ("run", "o/q.yaml", *short))
    )
    return Case("new", {name: content, **meshes(rng)}, (made, *then), links=tuple(links))


def _urdf_case(rng: Random, _: Any) -> Case:
    """A scenario of one's own with a robot of URDF and meshes."""
    name, content = robot(rng)
    tree = tree_of(
        {
            "name": "arm",
            "duration_s": 0.05,
            "time_step_s": 0.001,
            "control_period_s": 0.005,
            "conservative": rng.random() < 0.3,
            "robot": {"mjcf": name, "strip": rng.choice((["damping", "frictionloss", "limits", "servos"], []))},
            "contacts": {"ignored": [{"between": ["robot", "robot"], "reason": "links overlap"}]},
            "phases": [{"name": "rest", "until": "end", "controller": {"kind": "off"}}],
        }
    )
    if rng.random() < 0.2:
        mutate_tree(rng, tree)
    files = {name: content, "scenario.yaml": text(tree).encode("utf-8", "surrogatepass"), **meshes(rng)}
    return Case("urdf", files, commands(rng, "scenario.yaml"))


def _folder_case(rng: Random, logs: tuple[bytes, ...]) -> Case:
    """A run folder as a scenario, or as the place of another run, with links in it."""
    from tests.hostile.cases import model_text

    scenario = next(r.data for r in records(logs[0]) if isinstance(r, Attachment) and r.name == "scenario.yaml")
    files = {"run/scenario.yaml": scenario, "run/run.mcap": logs[0], "run/summary.json": b"{}"}
    files |= {r.name.join(("run/", "")): r.data for r in records(logs[0]) if isinstance(r, Attachment)}
    files["robot.xml"] = model_text("ffsm_3dof.xml")
    name = rng.choice(
        ("run.mcap", "run.mcap.partial", "summary.json", "scenario.yaml", "mjcf", "mjcf/robot", "run.rrd", "x")
    )
    for below in [each for each in files if each == f"run/{name}" or each.startswith(f"run/{name}/")]:
        del files[below]
    link = (f"run/{name}", f"{'../' * (2 + name.count('/'))}{rng.choice(_TARGETS)}")
    short = ("-s", "duration_s=0.02", "--no-rerun")
    command: Command = rng.choice(
        (
            ("run", "run", *short, "--out", "again"),
            *[("run", "coasting", *short, "--out", "run", "--force")] * 3,
            ("run", "coasting", *short, "--out", "run"),
            ("check", "run"),
            ("analyze", "run"),
        )
    )
    return Case("run folder", files, (command,), links=(link,))


_WORDS = ("", "-", "--", "-x", "--help", "\x1b[31m", "a\nb", "\u202e", "bash", "zsh", "nan", "--out", "--version", "D", "-h")


def _words_case(rng: Random, _: Any) -> Case:
    """Words that mean nothing, places that cannot be."""
    name = rng.choice((*["schema", "completion", "new-law", "validate", "view", "campaign", "export", "new", EVIL[:9]], ""))
    rest = tuple(rng.choice(_WORDS) for _ in range(rng.choice((0, 1, 1, 2, 3))))
    if name == "new-law":
        names = ("my_law", "My", "", "osdre", "a b", "../x", "class", "\x1b[2J", "x" * 300, "_", "1a", "off")
        rest = (rng.choice(names), *rng.choice(((), ("--out", rng.choice(("o", "file", "", "/proc", "link"))))))
    if name == "validate":  # its runs take minutes: pages that are not there end it before them
        rest = ("--check", rng.choice(("folder", "file", "", "nothing", "/proc", "link")))
    links = (("link", "../outside/folder"),) if "link" not in rest else (("link", "nowhere"),)
    return Case("words", {"file": b"x"}, ((name, *rest) if name else rest,), ("folder", "D"), links)


_KINDS: tuple[tuple[Any, int], ...] = (
    *((_log_case, 34), (_new_case, 12), (_urdf_case, 12), ("folder", 28), ("file", 4), (_folder_case, 4), (_words_case, 4)),
)
