"""Files with pieces: read bit for bit, refused where they are damaged or made up, whole though several write at once."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from ffsm_mj.decomposition.distances import distances
from ffsm_mj.decomposition.gate import gate
from ffsm_mj.decomposition.stored import FOLDER, Request, decompose, from_json, read_folder, stored_in, to_json, write
from ffsm_mj.errors import InputError
from tests.decomposition import meshes


def request(part=meshes.slot, **options):
    return Request(*part(), **{"method": "planes", "tolerance_m": None, "mesh": "a part", "place": "part.xml", **options})


@pytest.fixture(scope="module")
def pieces():
    return decompose(request())


def test_numbers_are_read_bit_for_bit(pieces):
    text = to_json(pieces)
    again = from_json(text, "file")
    assert to_json(again) == text
    assert again.sentence == pieces.sentence
    for one, other in zip(pieces.pieces, again.pieces, strict=True):
        assert one.faces == other.faces
        for array in ("vertices", "normals", "offsets"):
            np.testing.assert_array_equal(getattr(one, array), getattr(other, array))
    # 12 planes, some of them of several pieces in either sense.
    assert len(json.loads(text)["planes"]) == 12


def test_distances_are_rounding_and_see_what_differs(pieces):
    """Closed forms: a missing lip ends 12 mm from its wall and 10 mm above it; one that is moved reaches out by that."""
    surface = gate(*meshes.slot(), "slot").surface
    assert max(pieces.outside_m, pieces.uncovered_m) < 1e-14
    lip = next(k for k, one in enumerate(pieces.pieces) if one.bounds[0, 2] > 0.019)
    assert np.ptp(pieces.pieces[lip].vertices[:, 1]) == pytest.approx(0.022)
    others = [one for k, one in enumerate(pieces.pieces) if k != lip]
    apart = distances(surface, others)
    assert apart.outside_m < 1e-14
    assert apart.uncovered_m == pytest.approx(np.hypot(0.012, 0.010), rel=1e-12)
    apart = distances(surface, [*others, pieces.pieces[lip].moved(np.array([0.003, 0.0, 0.0]), np.eye(3))])
    assert apart.outside_m == pytest.approx(0.003, rel=1e-12)
    assert apart.uncovered_m == pytest.approx(0.003, rel=1e-12)


def changed(pieces, change):
    data = json.loads(to_json(pieces))
    change(data)
    return json.dumps(data).encode()


def damage(**values):
    return lambda data: data["pieces"][0].update(values)


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data.update(format="ffsm-mj pieces 2"),
        lambda data: data.update(method="import"),
        lambda data: data.update(planes=[]),
        lambda data: data.update(planes=data["planes"][:-1]),
        lambda data: data.update(pieces=5),
        lambda data: data.update(outside_m="far"),
        lambda data: data["planes"][0].__setitem__(3, float("nan")),
        lambda data: data["planes"][0].__setitem__(0, 2.0),
        lambda data: data["planes"][0].__setitem__(3, data["planes"][0][3] + 1.0),
        lambda data: data["pieces"][0]["vertices"][0].__setitem__(0, 1e9),
        lambda data: data["pieces"][0]["vertices"].pop(),
        lambda data: data["pieces"][0]["faces"].pop(),
        lambda data: data["pieces"][0]["faces"][0][2].append(0),
        lambda data: data["pieces"][0]["faces"][0][2].reverse(),
        lambda data: data["pieces"][0]["faces"][0].__setitem__(1, 3),
        lambda data: data["pieces"][0]["faces"][0].__setitem__(0, -1),
        lambda data: data["pieces"][0]["faces"][0].__setitem__(0, 2**80),
        damage(faces=[]),
        damage(vertices=[[0.0, 0.0]]),
        damage(vertices=None),
    ],
)
def test_what_is_damaged_or_made_up_is_refused(pieces, change):
    with pytest.raises(InputError, match=r"^file: is not a file with the pieces of a mesh, or damaged; remove it$"):
        from_json(changed(pieces, change), "file")


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"[" * 100_000, b"\xff\xfe", b"null"])
def test_what_is_no_such_file_is_refused(content):
    with pytest.raises(InputError, match=r"^file: is not a file"):
        from_json(content, "file")


def test_the_key_follows_from_mesh_and_options():
    first = request()
    moved = Request(first.vertices + 1e-16, first.faces, "planes", None, "a part", "part.xml")
    others = [request(tolerance_m=1e-9), request(method="coacd"), request(meshes.plate), moved]
    keys = [one.key("1") for one in (first, *others)] + [first.key("2")]
    assert len({*keys}) == len(keys)
    assert request(mesh="other").key("1") == first.key("1")
    assert first.name("1").startswith(f"{FOLDER}/a_part-")


def test_several_writers_leave_one_whole_file(tmp_path, pieces):
    asked = request()
    name, content = asked.name("1"), to_json(pieces)

    def work(_):
        write(tmp_path, name, content)
        return stored_in(asked, read_folder(tmp_path, asked), "", any_version=False)

    with ThreadPoolExecutor(8) as pool:
        read = list(pool.map(work, range(64)))
    assert all(one is not None and one[:2] == (name, content) for one in read)
    assert [path.name for path in (tmp_path / FOLDER).iterdir()] == [name.removeprefix(f"{FOLDER}/")]
