"""Exported tables and animations, read back by other tools."""

from __future__ import annotations

import csv

import imageio_ffmpeg
import numpy as np
import pyarrow.parquet
import pytest
from PIL import Image

from ffsm_mj.errors import InputError, MissingPackageError
from ffsm_mj.report import animation
from ffsm_mj.report.animation import write_animation
from ffsm_mj.report.export import write_table
from tests.scenes import two_balls


@pytest.fixture(scope="module")
def hit(tmp_path_factory, ffsm_run):
    return ffsm_run(two_balls(tmp_path_factory.mktemp("hit"), duration_s=0.5))


def test_csv_preserves_doubles(hit, tmp_path):
    write_table(hit, "samples", tmp_path / "x.csv", "csv")
    with (tmp_path / "x.csv").open() as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == list(hit.keys)
    np.testing.assert_array_equal(np.array(rows[1:], dtype=np.float64), hit.log.rows)


def test_parquet_contains_units_and_metadata_of_the_run(hit, tmp_path):
    write_table(hit, "samples", tmp_path / "x.parquet", "parquet")
    table = pyarrow.parquet.read_table(tmp_path / "x.parquet")
    np.testing.assert_array_equal(table["energy.total_J"], hit["energy.total_J"])
    assert table.field("energy.total_J").metadata == {b"unit": b"J", b"description": b"kinetic energy, total"}
    assert table.schema.metadata[b"scenario"] == b"scene"
    write_table(hit, "impacts", tmp_path / "i.parquet", "parquet")
    impacts = pyarrow.parquet.read_table(tmp_path / "i.parquet").to_pylist()
    assert [row["impulse_N_s"] for row in impacts] == [hit.impacts[0].impulse_N_s]


def test_gif_shows_the_motion(hit, tmp_path):
    """0.5 s at 10 frames per second are 6 frames; in the last one, the object has moved to the right."""
    said = write_animation(hit, tmp_path / "x.gif", frames_per_second=10.0)
    assert said == "6 frames, 0.6 s in real time"
    with Image.open(tmp_path / "x.gif") as film:
        assert film.n_frames == 6
        pictures = []
        for i in (0, 5):
            film.seek(i)
            pictures.append(np.asarray(film.convert("RGB")).astype(int))
    places = []
    for picture in pictures:
        orange = (picture[:, :, 0] - picture[:, :, 2]) > 60
        places.append(np.nonzero(orange.any(axis=0))[0].mean())
    assert places[1] > places[0] + 20


def test_mp4_has_every_frame(hit, tmp_path):
    write_animation(hit, tmp_path / "x.mp4", frames_per_second=10.0, speed=0.5)
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "x.mp4"))
    assert count == 11
    assert seconds == pytest.approx(1.1)


def test_faults_are_named(hit, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"animations are \.gif or \.mp4 files"):
        write_animation(hit, tmp_path / "x.avi")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_table(hit, "samples", tmp_path / "file" / "x.csv", "csv")

    def nothing(name):
        raise ImportError(name)

    monkeypatch.setattr(animation, "import_module", nothing)
    with pytest.raises(
        MissingPackageError, match=r"--mp4 needs the package imageio-ffmpeg; install .* --inexact --extra mp4"
    ):
        write_animation(hit, tmp_path / "x.mp4")
