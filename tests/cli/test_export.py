"""`cwcli export`: what other tools read out of the files is what the log holds."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli import __version__
from cwcli.cli.commands.export import CONTENT_NAMES_TEXT, EXPORT_FORMATS, format_of_each_suffix
from cwcli.errors import EXIT_MISSING_SIGNAL, EXIT_NOT_WRITTEN, EXIT_USAGE
from cwcli.export.content import CHANNEL_BY_EXPORT_CONTENT_NAME
from cwcli.export.track_formats import TRACK_FORMATS, Track
from tests.cli.conftest import SAMPLES, Run

TOPICS = {"ego": "/cwcli/ego/state", "remote": "/cwcli/remote/state"}
SUFFIXES = format_of_each_suffix()


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The intersection with everything."""
    from cwcli.cli.main import run_command_line

    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


def states(path: Path, what: str) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[Any]]]:
    """The channel as the official reader sees it."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [message for *_, message in reader.iter_decoded_messages([TOPICS[what]])]
    names = ("stamp_ns", "x_m", "y_m", "heading_rad", "speed_mps", "latitude_deg", "longitude_deg")
    return {name: np.array([getattr(message, name) for message in messages]) for name in names}


@pytest.mark.parametrize("what", TOPICS)
def test_tum_and_kitti_hold_the_poses(cwcli: Run, annotated: Path, what: str) -> None:
    expected = states(annotated, what)
    tum = np.loadtxt(io.BytesIO(cwcli("export", annotated, "--what", what, "--format", "tum").stdout))
    kitti = np.loadtxt(io.BytesIO(cwcli("export", annotated, "--what", what, "--format", "kitti").stdout))
    np.testing.assert_allclose(tum[:, 0], expected["stamp_ns"] / 1e9, atol=1e-6)
    np.testing.assert_allclose(tum[:, 1:3], np.stack([expected["x_m"], expected["y_m"]], axis=1), atol=1e-6)
    turned = 2.0 * np.arctan2(tum[:, 6], tum[:, 7]) - expected["heading_rad"]
    np.testing.assert_allclose(np.cos(turned), 1.0, atol=1e-12)
    matrices = kitti.reshape(-1, 3, 4)
    np.testing.assert_allclose(matrices[:, :2, 3], np.stack([expected["x_m"], expected["y_m"]], axis=1), atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(matrices[:, :, :3]), 1.0, atol=1e-9)
    np.testing.assert_allclose(matrices[:, 0, 0], np.cos(expected["heading_rad"]), atol=1e-9)
    np.testing.assert_allclose(matrices[:, 1, 0], np.sin(expected["heading_rad"]), atol=1e-9)


def test_stamps_keep_every_nanosecond() -> None:
    stamp_ns = 1_700_000_000_123_456_789
    one = np.zeros(1)
    track = Track("1", np.array([stamp_ns]), one, one, one, one, one, one)
    assert TRACK_FORMATS["tum"].encode([track]).startswith(b"1700000000.123456789 ")
    assert b"2023-11-14T22:13:20.123456789Z" in TRACK_FORMATS["gpx"].encode([track])
    assert b"2023-11-14T22:13:20.123456789Z" in TRACK_FORMATS["kml"].encode([track])


def test_tables_hold_what_the_channel_holds(cwcli: Run, annotated: Path, tmp_path: Path) -> None:
    expected = states(annotated, "remote")
    text = cwcli("export", annotated, "--what", "remote").stdout.decode()
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [int(row["stamp_ns"]) for row in rows] == expected["stamp_ns"].tolist()
    assert [float(row["x_m"]) for row in rows] == expected["x_m"].tolist()
    cwcli("export", annotated, "--what", "remote", "-o", "remote.parquet")
    read = pq.read_table(tmp_path / "remote.parquet").to_pydict()
    assert read["speed_mps"] == expected["speed_mps"].tolist()
    assert (len(read["sigma"][0]), len(read["correlation"][0])) == (8, 28)


@pytest.mark.parametrize("what", ["paths", "remote-paths", "warnings", "ego-online", "remote-online"])
def test_every_channel_is_a_table(cwcli: Run, annotated: Path, what: str) -> None:
    done = cwcli("export", annotated, "--what", what)
    assert done.returncode == 0, done.stderr.decode()
    assert len(done.stdout.splitlines()) > 10


def test_the_name_of_the_file_tells_the_format(cwcli: Run, annotated: Path, tmp_path: Path) -> None:
    done = cwcli("export", annotated, "-o", "ego.geojson", "--json")
    assert json.loads(done.stdout) == {
        "cwcli": __version__, "command": "export", "what": "ego", "format": "geojson",
        "output": "ego.geojson", "rows": 201,
    }  # fmt: skip
    assert json.loads((tmp_path / "ego.geojson").read_text())["type"] == "FeatureCollection"


@pytest.mark.parametrize(("suffix", "form"), sorted(SUFFIXES.items()))
def test_every_format_is_written_for_its_suffix_alone(
    cwcli: Run, annotated: Path, tmp_path: Path, suffix: str, form: str
) -> None:
    """The file is the one that --format gives, for each name of the registry and for tables and logs."""
    by_suffix = cwcli("export", annotated, "-o", f"a{suffix.upper()}", "--json")
    assert by_suffix.returncode == 0, by_suffix.stderr.decode()
    assert json.loads(by_suffix.stdout)["format"] == form
    by_option = cwcli("export", annotated, "--format", form, "-o", f"b{suffix}")
    assert by_option.returncode == 0, by_option.stderr.decode()
    assert (tmp_path / f"a{suffix.upper()}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_every_format_has_a_suffix_that_no_other_has() -> None:
    assert set(SUFFIXES.values()) == set(EXPORT_FORMATS)
    of_tracks = [suffix for each in TRACK_FORMATS.values() for suffix in each.suffixes]
    assert sorted(set(of_tracks)) == sorted(of_tracks)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("x.xyz", "no format ends in .xyz"),
        ("x.kiti", "no format ends in .kiti"),
        ("drive.2026-01-02", "no format ends in .2026-01-02"),
        ("x.csv.gz", "no format ends in .gz"),
        ("x.mcap", "osi and ros2 are both written as .mcap"),
    ],
)
def test_a_suffix_that_names_no_format_is_refused(
    cwcli: Run, annotated: Path, tmp_path: Path, name: str, said: str
) -> None:
    done = cwcli("export", annotated, "-o", name)
    told = " ".join(done.stderr.decode().split())
    assert (done.returncode, done.stdout, list(tmp_path.iterdir())) == (EXIT_USAGE, b"", [])
    assert said in told
    for suffix in SUFFIXES if ".mcap" not in name else (".osi.mcap", ".ros2.mcap"):
        assert suffix in told
    assert cwcli("export", annotated, "-o", name, "--format", "kitti").returncode == 0


def test_a_name_without_a_suffix_is_a_table(cwcli: Run, annotated: Path, tmp_path: Path) -> None:
    """The default that the help tells; devices and pipes have such names."""
    assert cwcli("export", annotated, "-o", "ego").returncode == 0
    assert (tmp_path / "ego").read_bytes() == cwcli("export", annotated).stdout


def test_help_names_everything() -> None:
    assert ", ".join(CHANNEL_BY_EXPORT_CONTENT_NAME) == CONTENT_NAMES_TEXT
    assert set(EXPORT_FORMATS) == {"csv", "parquet", *TRACK_FORMATS, "ros2"}


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--what", "dreams"], EXIT_USAGE, "it is one of: ego, ego-online"),
        (["--format", "xls"], EXIT_USAGE, "it is one of: csv, parquet, tum"),
        (["--what", "warnings", "--format", "gpx"], EXIT_USAGE, "export it as csv or parquet"),
        (["--what", "remote", "--format", "tum", "--id", "7"], EXIT_USAGE, "it holds d9583520"),
        (["--what", "remote", "--id", "7"], EXIT_USAGE, "it holds d9583520"),
        (["--what", "lanes"], EXIT_MISSING_SIGNAL, "`cwcli lanes LOG -o annotated.mcap` makes it"),
        (["-o", "there.csv"], EXIT_NOT_WRITTEN, "the file exists"),
    ],
)
def test_errors_are_one_line(
    cwcli: Run, annotated: Path, tmp_path: Path, arguments: Sequence[str], code: int, said: str
) -> None:
    (tmp_path / "there.csv").write_text("mine")
    done = cwcli("export", annotated, *arguments)
    assert done.returncode == code
    assert said in " ".join(done.stderr.decode().split())
    assert done.stdout == b""
    assert (tmp_path / "there.csv").read_text() == "mine"


def test_one_vehicle_is_chosen_by_its_id(cwcli: Run, annotated: Path) -> None:
    assert cwcli("export", annotated, "--what", "remote", "--format", "tum", "--id", "d9583520").returncode == 0
    assert len(cwcli("export", annotated, "--what", "remote", "--id", "d9583520").stdout.splitlines()) == 202


def test_a_drive_without_a_warning_becomes_a_ros_log(cwcli: Run) -> None:
    """Its channel of warnings is there, and holds none."""
    for arguments in (
        ("simulate", "parallel-lanes", "-o", "drive.mcap"),
        ("run", "drive.mcap", "-o", "run.mcap"),
        ("export", "run.mcap", "--format", "ros2", "-o", "ros.mcap"),
    ):
        done = cwcli(*arguments, "--quiet")
        assert done.returncode == 0, done.stderr.decode()
