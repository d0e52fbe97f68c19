"""Mutated campaign files (trusted, possibly wrong) and campaign folders (possibly hostile)."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path
from random import Random
from typing import Any

from tests.hostile.cases import Case, Command
from tests.hostile.documents import Map, text, tree_of
from tests.hostile.log_mutations import mutate_log
from tests.hostile.values import NUMBERS, SCALARS, words
from tests.hostile.yaml_mutations import mutate_bytes, mutate_tree, value

Files = dict[str, bytes]
EVIL = "\x1b]0;owned\x07\x1b[31m\u202e\u2066$x ${y} $$ |`<b>\n# all well\r\t\0"
_STATED = {
    "campaign": "hits",
    "scenario": "scene.yaml",
    "samples": {"kind": "random", "n": 4, "seed": 1},
    "dispersions": {
        "initial.rates.robot/free.0": {"uniform": [0.8, 1.6]},
        "contacts.rules.second.restitution": {"choice": [0.2, 0.5]},
    },
    "metrics": ["impacts.count", "impacts.0.impulse_N_s", "drift"],
    "success": "impacts.count > 0",
    "keep": {"worst": {"drift": 1}},
    "limits": {"max_failed": 1.0},
}


def scene_files(folder: Path) -> Files:
    """The scenario of a campaign with its models, by name."""
    from tests.experiments.files import rock_hits

    rock_hits(folder)
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "campaign.yaml"}


def campaign_folder(folder: Path) -> Files:
    """The files of a finished campaign's folder with the log of one run, made here, run by run in this process."""
    from ffsm_mj.experiments.campaign import Campaign
    from ffsm_mj.experiments.executors import Loop

    (folder / "campaign.yaml").write_text(json.dumps(_STATED))
    campaign = Campaign.load(folder / "campaign.yaml", folder / "D")
    campaign.run(Loop())
    campaign.rerun(0)
    return {f"D/{path.relative_to(folder / 'D')}": path.read_bytes() for path in (folder / "D").rglob("*") if path.is_file()}


def campaign_file_case(rng: Random, scene: Files) -> Case:
    """A campaign file with something in it that nobody meant: checked, and run where it is taken."""
    tree = tree_of(json.loads(json.dumps(_STATED)))
    assert isinstance(tree, Map)
    for _ in range(rng.choice((0, 1, 1, 2))):
        mutate_tree(rng, tree)
    if rng.random() < 0.3:
        kind = rng.choice(("grid", "lhs", "sobol", "saltelli", "random"))
        tree.pairs.append(("samples", Map([("kind", kind), ("n", rng.choice((1, 2, 3, 4))), ("seed", 1)])))
    data = text(tree).encode("utf-8", "surrogatepass")
    if rng.random() < 0.1:
        data = mutate_bytes(rng, data)
    more = ("-s", f"samples.n={value(rng)}".replace("\0", " ")) if rng.random() < 0.1 else ()
    run: Command = ("campaign", "run", "campaign.yaml", "-s", "samples.n=2", *more, "--out", "D")
    then: tuple[Command, ...] = (("campaign", "status", "D"), ("campaign", "report", "D"))
    return Case("campaign file", {**scene, "campaign.yaml": data}, (("check", "campaign.yaml", *more), run, *then))


def campaign_folder_case(rng: Random, made: Files) -> Case:
    """A folder that somebody else has sent: looked at, or gone on with."""
    files = dict(made)
    links: list[tuple[str, str]] = []
    for _ in range(rng.choice((1, 1, 2, 3))):
        rng.choice(_MUTATIONS)(rng, files, links)
    command: Command = rng.choice(
        (
            *(("status", "D"), ("status", "D"), ("report", "D"), ("report", "D"), ("report", "D")),
            *(("report", "D", "--page", "page.md"), ("resume", "D"), ("resume", "D", "--retry", "error")),
            *(("extend", "D", "6"), ("rerun", "D", "0"), ("rerun", "D", "3", "99")),
        )
    )
    return Case(f"campaign {command[0]}", files, (("campaign", *command),), links=tuple(links))


def _bytes(rng: Random, files: Files, _: Any) -> None:
    if files:
        name = rng.choice(sorted(files))
        files[name] = mutate_bytes(rng, files[name])


def _table_bytes(rng: Random, files: Files, _: Any) -> None:
    if "D/rows.sqlite" in files:
        data = bytearray(files["D/rows.sqlite"])
        for _ in range(rng.choice((1, 3, 30))):
            if data:
                data[rng.randrange(len(data))] = rng.choice((0, 1, 5, 10, 13, 255, rng.randrange(256)))
        files["D/rows.sqlite"] = bytes(data)


def _table(rng: Random, files: Files, _: Any) -> None:
    """A statement that SQLite takes."""
    db = sqlite3.connect(":memory:")
    try:
        db.deserialize(files.get("D/rows.sqlite", b""))
        column = rng.choice(("i", "outcome", "message", "phase", "failed", "metrics", "model", "cpu", "wall_s", "cpu_s"))
        some = rng.choice(("i = 2", "i = 0", "1", "i > 1"))
        new: Any = rng.choice(
            (None, EVIL, b"\xff\0", 1e308, -1, 2**62, float("inf"), "{", "[" * 3000, _metrics(rng), "null")
        )
        with db:
            statement = rng.choice((*_STATEMENTS, *[f"UPDATE rows SET {column} = ? WHERE {some}"] * 12))
            db.execute(statement, (new,) * statement.count("?"))
        files["D/rows.sqlite"] = db.serialize()
    except (sqlite3.Error, MemoryError):
        pass  # not taken, so there is no such file
    finally:
        db.close()


_ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 0 UNION ALL SELECT i + 1 FROM n)"
_STATEMENTS = (
    "CREATE VIEW v AS SELECT 1",
    f"CREATE VIEW more AS {_ENDLESS} SELECT * FROM n",
    "CREATE TRIGGER t AFTER INSERT ON rows BEGIN DELETE FROM settings; END",
    "CREATE TABLE x (y)",
    "DROP TABLE rows",
    "DELETE FROM rows",
    "DELETE FROM settings",
    "UPDATE settings SET content = ?",
    "INSERT INTO settings VALUES (?)",
    "ALTER TABLE rows RENAME TO r",
)


def _metrics(rng: Random) -> str:
    odd = rng.choice(('"\\u001b[31m"', "NaN", "Infinity", "-1e999", "[]", "{}", "null", "true", *NUMBERS, '"$a$"'))
    name = rng.choice(("drift", "impacts.count", "checks_pass", "$a$", "\\u001b[2J", "run", "impacts.0.impulse_N_s"))
    return f'{{"{name}": {odd}, "checks_pass": {rng.choice(("true", "false", "3"))}}}'


def _journal(rng: Random, files: Files, _: Any) -> None:
    magic = bytes.fromhex("d9d505f920a163d7")
    head = magic + bytes(rng.choice((20, 504, 1016)))
    name = b"../outside/precious"
    tail = bytes(4) + name + len(name).to_bytes(4, "big") + sum(name).to_bytes(4, "big") + magic
    files["D/rows.sqlite" + rng.choice(("-journal", "-journal", "-wal", "-shm"))] = rng.choice(
        (head + tail, head, tail, b"x")
    )


def _json(rng: Random, files: Files, _: Any) -> None:
    """A value of the design that is another."""
    try:
        tree = tree_of(json.loads(files["D/design.json"]))
    except (KeyError, ValueError):
        return
    if isinstance(tree, Map):
        mutate_tree(rng, tree)
        words = _as_json(tree)
        files["D/design.json"] = words.replace('"value"', json.dumps(EVIL), rng.random() < 0.1).encode("utf-8", "replace")


def _as_json(node: Any) -> str:
    if isinstance(node, Map):
        return "{" + ", ".join(f"{json.dumps(key)}: {_as_json(item)}" for key, item in node.pairs) + "}"
    if isinstance(node, list):
        return "[" + ", ".join(map(_as_json, node)) + "]"
    return node.text if hasattr(node, "text") else json.dumps(node)


def _yaml(rng: Random, files: Files, _: Any) -> None:
    """Something of the campaign file or of its scenario, line by line."""
    name = rng.choice(("D/campaign.yaml", "D/scenario/scenario.yaml"))
    lines = files.get(name, b"").split(b"\n")
    at = rng.randrange(len(lines))
    key = lines[at].split(b":")[0]
    odd = rng.choice((*SCALARS, *NUMBERS, json.dumps(EVIL))).encode("utf-8", "replace")
    lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [key + b": " + odd], [key + b": " + odd], [b"  " + lines[at]]))
    files[name] = b"\n".join(lines)


def _gone(rng: Random, files: Files, _: Any) -> None:
    if not files:
        return
    name = rng.choice(sorted(files))
    del files[name]
    if rng.random() < 0.3:
        files[f"{name}/x"] = b""  # a folder instead


def _log(rng: Random, files: Files, _: Any) -> None:
    name = "D/reruns/000000/run.mcap"
    if name in files:
        files[name] = mutate_log(rng, files[name])


def _link(rng: Random, files: Files, links: list[tuple[str, str]]) -> None:
    """A link in the place of something that is there, or that will be written."""
    name = rng.choice((*_WRITTEN, *sorted(files)))
    target = rng.choice(("precious", "folder", "folder/new", "log.mcap", "new"))
    for below in [each for each in files if each == name or each.startswith(f"{name}/")]:
        del files[below]
    links.append((name, f"{'../' * (name.count('/') + 1)}outside/{target}"))


_WRITTEN = words("""D/report.md D/results.csv D/results.parquet D/figures D/figures/report
        D/figures/report/convergence.png D/driver.lock D/reruns D/reruns/000000 D/reruns/000003
        D/rows.sqlite D/rows.sqlite-journal D/rows.sqlite-wal D/rows.sqlite-shm D/design.json
        D/campaign.yaml D/scenario page.md figures D/reruns/000000/run.mcap D/reruns/000000/mjcf
        D/reruns/000000/summary.json D""")
_MUTATIONS = (_bytes, _table_bytes, _table, _table, _table, _journal, _json, _json, _yaml, _yaml, _gone, _log, _link, _link)
