"""`cwcli find` on the command line: one log, a run's folder, tables, clips; what is missing; refusals."""

from __future__ import annotations

import base64
import csv
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_DONE, EXIT_MISSING_SIGNAL, EXIT_USAGE
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.report.frames import make_thumbnails_and_explain_gaps
from cwcli.signals.columns import OutputChannel, Ragged, Strings
from cwcli.vision.overlay import encode_jpeg
from tests.laws.planted_drives import planted_drive, write_drive

FRAME_PERIOD_NS, N_FRAMES, FIRST_GREY = 333_000_000, 180, 40
"""The camera of `write_with_camera`: time between frames, number of frames, grey level of the first one."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cut-in, a stop-and-go, and a log that holds no states."""
    folder = tmp_path_factory.mktemp("logs")
    for kind in ("cut-in", "stop-and-go"):
        write_drive(planted_drive(kind, 3), folder / f"{kind}.mcap", 3)
    code = run_command_line(
        ["cut", str(folder / "cut-in.mcap"), "--topics", "/gps/fix,/imu/data", "-o", str(folder / "raw.mcap"), "-q"]
    )
    assert code == EXIT_DONE
    return folder


def found(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    capsys.readouterr()
    assert run_command_line(["find", *arguments, "--json"]) == EXIT_DONE
    return dict(json.loads(capsys.readouterr().out))


def test_events_of_a_folder_with_tables_and_clips(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, clips = tmp_path / "found.parquet", tmp_path / "clips"
    said = found(capsys, str(folder), "cut-in or stop-and-go", "-o", str(table), "--clips", str(clips), "--margin", "5")
    events = said["events"]
    assert isinstance(events, list)
    assert {each["event"] for each in events} == {"cut-in", "stop-and-go"}
    assert [each["severity"] for each in events] == sorted((each["severity"] for each in events), reverse=True)
    assert [each["log"].rpartition("/")[2] for each in said["failed"]] == ["raw.mcap"]  # type: ignore[attr-defined]
    assert pq.read_table(table).column("id").to_pylist() == [each["id"] for each in events]
    for each in events:
        source, clip = folder / f"{each['event']}.mcap", Path(each["clip"])
        first_ns, last_ns = each["start_ns"] - 5 * 10**9, each["end_ns"] + 5 * 10**9
        with source.open("rb") as whole, clip.open("rb") as part:
            inside = {
                (channel.topic, m.log_time, m.publish_time, m.sequence, m.data)
                for _, channel, m in make_reader(whole).iter_messages()
                if first_ns <= m.log_time <= last_ns
            }
            written = {
                (channel.topic, m.log_time, m.publish_time, m.sequence, m.data)
                for _, channel, m in make_reader(part, validate_crcs=True).iter_messages()
            }
        assert written == inside
        again = found(capsys, str(clip), str(each["event"]))["events"]
        assert [other["id"] for other in again] == [each["id"]]  # type: ignore[attr-defined]


def test_limit_keeps_the_most_severe(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "found.csv"
    said = found(capsys, str(folder), "ego.speed_mps > 1 or ego.speed_mps < 0.5", "--limit", "2", "-o", str(target))
    assert len(said["events"]) == 2 < said["found"]  # type: ignore[arg-type,operator]
    with target.open() as stream:
        assert len(list(csv.DictReader(stream))) == 2


def test_terminal_shows_a_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["find", str(folder / "cut-in.mcap"), "all"]) == EXIT_DONE
    said = capsys.readouterr()
    assert "find all: 1 event in 1 log" in said.out
    assert "lane-departure: not searched in 1 log without the channels that this needs" in said.out + said.err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("raw.mcap", "cut-in"), EXIT_MISSING_SIGNAL, "no channel holds the ego state"),
        (("cut-in.mcap", "cutin"), EXIT_USAGE, "did you mean cut-in?"),
        (("cut-in.mcap", "disagreement"), EXIT_USAGE, "needs the other system's warnings"),
        (("none*.mcap", "cut-in"), EXIT_USAGE, "no file matches"),
        (("cut-in.mcap",), EXIT_USAGE, "an argument is missing: cwcli find LOG... EXPR"),
        (("*.mcap", "/adas/fcw:dat > 0"), EXIT_MISSING_SIGNAL, "/adas/fcw has no field dat: cut-in.mcap, stop-and-go"),
        (("*.mcap", "/adas/fcw:dat > 0"), EXIT_MISSING_SIGNAL, "there is no topic /adas/fcw: raw.mcap"),
        (("cut-in.mcap", "cut-in", "--margin", "-1"), EXIT_USAGE, "--margin"),
        (("cut-in.mcap", "cut-in", "-o", "table.txt"), EXIT_USAGE, "Parquet or CSV"),
    ],
)
def test_refusals(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    code: int,
    words: str,
) -> None:
    monkeypatch.chdir(folder)
    assert run_command_line(["find", *arguments]) == code
    assert words in " ".join(capsys.readouterr().err.split())


def test_what_happened_is_told_in_words(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stranger reads a sentence with a unit; names of columns are for programs."""
    event = found(capsys, str(folder / "cut-in.mcap"), "cut-in")["events"][0]  # type: ignore[index]
    assert re.fullmatch(r"enters the ego's lane \d+ m, \d\.\d s ahead of it", event["words"])
    assert f"{event['value']:.1f} s ahead" in event["words"]
    event = found(capsys, str(folder / "stop-and-go.mcap"), "stop-and-go")["events"][0]  # type: ignore[index]
    assert event["words"] == f"{event['value']:.0f} stops"
    one = found(capsys, str(folder / "cut-in.mcap"), "max(ego.speed_mps) over 1 s > 1")["events"][0]  # type: ignore[index]
    assert one["words"] == f"max ego.speed {one['value']:.2f} m/s"
    assert run_command_line(["find", str(folder / "cut-in.mcap"), "cut-in"]) == EXIT_DONE
    assert "headway_s" not in capsys.readouterr().out


def test_page_has_a_card_with_figures_and_its_clip_for_each_event(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, clips = tmp_path / "page.html", tmp_path / "clips"
    options = ("--report", str(page), "--clips", str(clips), "--margin", "5")
    events = found(capsys, str(folder), "cut-in or stop-and-go", *options)["events"]
    root = ElementTree.fromstring(page.read_text().replace("<!doctype html>", ""))
    cards = {each.get("id"): each for each in root.iter("article")}
    assert list(cards) == [each["id"] for each in events]  # type: ignore[attr-defined]
    for each in events:  # type: ignore[attr-defined]
        card = cards[each["id"]]
        assert each["words"] in "".join(card.itertext())
        (link,) = card.iter("a")
        assert (page.parent / str(link.get("href"))).resolve() == Path(each["clip"]).resolve()
        drawn = list(card.iter("svg"))
        assert len(drawn) == (3 if each["event"] == "cut-in" else 2)  # map, speeds, and the distance of two
        assert all(path.get("d", "").startswith("M") for svg in drawn for path in svg.iter("path"))
        # the grey area is the event: it begins `margin` seconds after the begin of the strip
        (area,) = drawn[1].iter("rect")
        times = [float(text.text or "nan") for text in drawn[1].iter("text") if text.get("y") == "89"]
        share = -times[0] / (times[1] - times[0])
        assert abs(float(area.get("x", "nan")) - (44 + share * 308)) < 4.0
    assert "<script" not in page.read_text()


def test_a_card_of_two_vehicles_that_close_in_shows_the_time_to_collision(folder: Path, tmp_path: Path) -> None:
    """The strip spans from 0 s to what is below 10 s; the planted gap closes to a time to contact below 1.5 s."""
    log, page = write_drive(planted_drive("near-miss", 3), tmp_path / "log.mcap", 3), tmp_path / "page.html"
    assert run_command_line(["find", str(log), "near-miss", "--report", str(page), "-q"]) == EXIT_DONE
    drawn = re.findall(r"<svg(.*?)</svg>", page.read_text())
    (strip,) = [each for each in drawn if "time to collision (TTC) [s]" in each]
    greatest, least = (float(each) for each in re.findall(r'text-anchor="end">([\d.]+)<', strip)[:2])
    assert least == 0.0 and 1.5 < greatest <= 10.0
    assert run_command_line(["find", str(folder / "stop-and-go.mcap"), "stop-and-go", "--report", str(page), "-f"]) == 0
    assert "TTC" not in page.read_text()


def test_page_of_names_that_are_html_and_of_logs_without_states(folder: Path, tmp_path: Path) -> None:
    evil = tmp_path / "<b>&.mcap"
    evil.write_bytes((folder / "raw.mcap").read_bytes())
    page = tmp_path / "page.html"
    assert run_command_line(["find", str(evil), "/gps/fix:x > -1000000", "--report", str(page)]) == EXIT_DONE
    assert "&lt;b&gt;&amp;.mcap" in page.read_text()
    assert "<b>&" not in page.read_text()
    assert "Not drawn: no channel holds the ego state" in page.read_text()
    assert run_command_line(["find", str(folder / "cut-in.mcap"), "cut-in", "--report", "p.txt"]) == EXIT_USAGE


def write_with_camera(source: Path, target: Path) -> None:
    """The log with a camera at 3 Hz whose frames get brighter by one grey level each; the last one is no JPEG."""
    with Log.open(source) as log:
        times = log.start_ns + np.arange(N_FRAMES) * FRAME_PERIOD_NS
        files = [encode_jpeg(np.full((96, 128, 3), FIRST_GREY + k, np.uint8)) for k in range(N_FRAMES - 1)]
        files.append(np.frombuffer(b"no picture", np.uint8))
        offsets = np.concatenate([[0], np.cumsum([len(each) for each in files])]).astype(np.int64)
        images: dict[str, Any] = {
            "timestamp": times,
            "data": Ragged(np.concatenate(files), offsets),
            "format": Strings(np.zeros(N_FRAMES, np.int32), ("jpeg",)),
        }
        annotate_log(log, [OutputChannel("/camera/image", "foxglove.CompressedImage", times, images)], {}, target)


def test_a_card_shows_the_camera_frame_at_the_start_of_the_event(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The grey level tells which frame it is. A log without states has its frame, too."""
    seen, raw, page = tmp_path / "seen.mcap", tmp_path / "raw.mcap", tmp_path / "page.html"
    write_with_camera(folder / "cut-in.mcap", seen)
    topics = "/gps/fix,/camera/image"
    assert run_command_line(["cut", str(seen), "--topics", topics, "-o", str(raw), "-q"]) == EXIT_DONE
    fields = "/gps/fix:x > -1000000"
    for source, query in ((seen, "cut-in"), (raw, fields)):
        events: Any = found(capsys, str(source), query, "--report", str(page), "--force")["events"]
        (event,) = events
        (image,) = ElementTree.fromstring(page.read_text().replace("<!doctype html>", "")).iter("img")
        data = base64.b64decode(str(image.get("src")).removeprefix("data:image/jpeg;base64,"))
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert picture is not None and picture.shape == (240, 320)
        nearest = round(event["start_s"] / (FRAME_PERIOD_NS / 1e9))
        assert abs(float(picture.mean()) - (FIRST_GREY + nearest)) < 0.5
        off_s = nearest * FRAME_PERIOD_NS / 1e9 - event["start_s"]
        assert image.get("alt") == f"camera {off_s:+.2f} s from the event's start"
        assert "img-src data:" in page.read_text()  # else the page's own policy hides it
    assert len(page.read_bytes()) < 20_000


def test_a_frame_that_is_no_picture_is_told(folder: Path, tmp_path: Path) -> None:
    write_with_camera(folder / "cut-in.mcap", tmp_path / "seen.mcap")
    with Log.open(tmp_path / "seen.mcap") as log:
        last_ns = log.start_ns + (N_FRAMES - 1) * FRAME_PERIOD_NS
        thumbnails, why = make_thumbnails_and_explain_gaps(log, "/camera/image", None, [last_ns], is_part=True)
    assert not thumbnails
    assert why == "some camera frames could not be decoded: neither JPEG, PNG nor WebP"


def test_gaps_are_found_without_states(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert found(capsys, str(folder / "raw.mcap"), "sensor-gap or gnss-outage")["events"] == []


def test_one_drive_in_two_folders_keeps_its_clips_and_its_names_apart(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs, clips, page = [tmp_path / "x" / "d.mcap", tmp_path / "y" / "d.mcap"], tmp_path / "clips", tmp_path / "p.html"
    for log in logs:
        log.parent.mkdir()
        log.write_bytes((folder / "cut-in.mcap").read_bytes())
    arguments = (*map(str, logs), "cut-in", "--clips", str(clips), "--report", str(page))
    events = found(capsys, *arguments)["events"]
    assert isinstance(events, list)
    assert sorted(Path(each["clip"]).name[:8] for each in events) == ["x_d_cut-", "y_d_cut-"]
    anchors = re.findall(r'<article id="([^"]+)"', page.read_text(encoding="utf-8"))
    assert len(anchors) == len(set(anchors)) == len(events) == 2
    assert run_command_line(["find", *arguments[:2], "cut-in"]) == EXIT_DONE
    assert set(re.findall(r"^ *([xy]/d\.mcap)", capsys.readouterr().out, re.MULTILINE)) == {"x/d.mcap", "y/d.mcap"}
    (clips / Path(events[0]["clip"]).name).unlink()
    assert run_command_line(["find", *arguments[:5]]) != EXIT_DONE
    assert len(list(clips.iterdir())) == 1  # the clip that is there is refused before another is written
    assert "the file exists" in capsys.readouterr().err
    assert run_command_line(["find", *arguments, "--force"]) == EXIT_DONE
    assert len(list(clips.iterdir())) == 2


def test_two_expressions_that_begin_together_have_ids_of_their_own(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(folder / "cut-in.mcap")
    ids = [found(capsys, log, f"ego.speed_mps > {limit}")["events"][0]["id"] for limit in (0.5, 1.0)]  # type: ignore[index]
    assert ids[0] != ids[1]
