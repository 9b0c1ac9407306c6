"""`cwcli export`: GDAL finds in the files for maps what the log holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest

from cwcli.export.track_formats import TRACK_FORMATS, Track
from tests.cli.conftest import Run
from tests.cli.test_export import TOPICS, annotated, states

__all__ = ["annotated"]  # a fixture


def fields(path: Path, layer: str | None) -> dict[str, Any]:
    """The attributes of a layer's features, by name, as GDAL reads them."""
    meta, _, _, columns = pyogrio.raw.read(path, layer=layer, read_geometry=False)
    return dict(zip(meta["fields"], columns, strict=True))


def points(geometry: bytes, per_point: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The coordinates of a line string in well-known binary: order, type, count, then doubles."""
    assert geometry[0] == 1  # little-endian
    return np.frombuffer(geometry[9:], "<f8").reshape(-1, per_point)[:, :2]


@pytest.mark.parametrize("what", TOPICS)
def test_gdal_reads_the_places_of_every_map_format(cwcli: Run, annotated: Path, tmp_path: Path, what: str) -> None:
    held = states(annotated, what)
    expected = np.stack([held["longitude_deg"], held["latitude_deg"]], axis=1)
    for name, layer, per_point in (("gpx", "tracks", 2), ("kml", None, 3), ("geojson", None, 2)):
        done = cwcli("export", annotated, "--what", what, "-o", f"track.{name}")
        assert done.returncode == 0, done.stderr.decode()
        _, _, (geometry, *more), _ = pyogrio.raw.read(tmp_path / f"track.{name}", layer=layer)
        assert more == []
        inner = geometry[9:] if name == "gpx" else geometry  # a multi line string of one
        np.testing.assert_allclose(points(inner, per_point), expected, atol=1e-9)


def test_gdal_reads_the_times_of_gpx(cwcli: Run, annotated: Path, tmp_path: Path) -> None:
    cwcli("export", annotated, "-o", "track.gpx")
    times = fields(tmp_path / "track.gpx", layer="track_points")["time"].astype("datetime64[ms]").astype(np.int64)
    np.testing.assert_allclose(times * 1e6, states(annotated, "ego")["stamp_ns"], atol=1e6)


@pytest.mark.parametrize("name", ["gpx", "kml", "geojson"])
def test_hostile_ids_leave_a_file_that_can_be_read(tmp_path: Path, name: str) -> None:
    two = np.zeros(2)
    evil = "</name><trk>&\x00\x1b[31m\ud800\"'<!--"
    track = Track(evil, np.array([0, 1]), two, two, two, two, two, two)
    path = tmp_path / f"evil.{name}"
    path.write_bytes(TRACK_FORMATS[name].encode([track]))
    read = fields(path, layer="tracks" if name == "gpx" else None)
    (told,) = read[{"gpx": "name", "kml": "Name", "geojson": "id"}[name]]
    assert told.startswith("</name><trk>&")
