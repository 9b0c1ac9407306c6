"""`cwcli report`: the page is whole, drawn, small, the same each time, and obeys nobody but its own scripts."""

from __future__ import annotations

import base64
import json
import math
import os
import re
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cwcli.errors import EXIT_BAD_INPUT, EXIT_MISSING_SIGNAL, EXIT_NOT_WRITTEN, EXIT_USAGE
from cwcli.logs.read.added_channels import columns_of_added_channel
from cwcli.logs.read.reader import Log
from cwcli.logs.write.annotate import annotate_log
from cwcli.report.overview import MAX_PAGE_BYTES
from cwcli.signals.columns import OutputChannel, Ragged, Strings
from cwcli.vision.overlay import encode_jpeg
from tests.cli.browser import Elements, Visit, figures, visit
from tests.cli.conftest import SAMPLES, Run

EVIL = (
    "</script><script>document.documentElement.dataset.pwned=1</script>"
    '<img src=x onerror="document.documentElement.dataset.pwned=1">'
    "\"' onmouseover='document.documentElement.dataset.pwned=1' "
    '<a href="javascript:document.documentElement.dataset.pwned=1">x</a>{{7*7}}%{x}&lt;b&gt;\u202e\x1b[31m'
)
SHORT_EVIL = "<img src=x onerror=document.documentElement.dataset.pwned=1>"
OWN_ADDRESS = re.compile(r"#(log-\d+[a-z-]*|(warning|conflict)-[0-9a-f]+)")
EVIL_ID = '<a href="javascript:x()">y</a><img>'
"""Short enough to be shown whole in a figure; Plotly would make a link of it."""


def drawn(visited: Visit) -> int:
    """How many figures the browser drew; all of them must be."""
    elements = Elements(visited.dom)
    states = [each.get("data-state") for each in elements.of("div") if "plot" in each.get("class", "").split()]
    assert 'data-plots="drawn"' in visited.dom
    return states.count("drawn")


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The intersection with everything."""
    from cwcli.cli.main import run_command_line

    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


@pytest.fixture(scope="module")
def page(annotated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its report."""
    from cwcli.cli.main import run_command_line

    target = tmp_path_factory.mktemp("page") / "report.html"
    assert run_command_line(["report", str(annotated), "-o", str(target), "--quiet"]) == 0
    return target


def test_story_says_what_happened(page: Path) -> None:
    text = page.read_text()
    assert (
        "<h1>At 4.7 s cwcli warned that the car would collide with vehicle d9583520, coming from the right; they did: "
        "at 7.2 s their outlines overlap, with 1.4 m between their centres.</h1>"
    ) in text
    assert "The warning was right: it came 2.4 s before" in text


def test_page_is_drawn_without_network_and_without_a_word_on_the_console(page: Path, tmp_path: Path) -> None:
    shot = tmp_path / "first-screen.png"
    visited = visit(page, tmp_path, screenshot=shot)
    assert drawn(visited) == 10  # map, fan, distance, motion, errors, residuals of five quantities
    assert visited.dom.count("main-svg") >= 5
    assert visited.console == ()
    assert visited.urls == ()
    assert shot.stat().st_size > 20_000


def test_first_screen_holds_verdict_map_and_warning(page: Path) -> None:
    # in document order: headline, verdict, map and fan, before anything else
    text = page.read_text()
    order = [text.index(part) for part in ("<h1>", 'class="badges"', 'id="log-1-map"', 'id="log-1-fan-1"', "<h3>")]
    assert order == sorted(order)


def test_figures_show_what_the_tracks_say(page: Path) -> None:
    found = figures(page.read_text())
    residuals = {f"log-1-residuals-{n}" for n in range(1, 6)}  # position, heading, speed, and the IMU's two
    assert set(found) == {"log-1-map", "log-1-fan-1", "log-1-distance-1", "log-1-motion", "log-1-errors", *residuals}
    traces, layout = found["log-1-map"]["data"], found["log-1-map"]["layout"]
    assert isinstance(traces, list) and isinstance(layout, dict)
    names = [trace["name"] for trace in traces]
    assert {"warning given", "nearest approach", "start"} <= set(names)
    tracks = [names.index(name) for name in ("vehicle d9583520", "the truth", "the car, estimated")]
    assert names[0] == "raw position fixes" and tracks == sorted(tracks)  # the car lies above the others
    assert layout["yaxis"]["scaleanchor"] == "x"
    for each in "xy":  # nothing ends on the frame
        low, high = layout[f"{each}axis"]["range"]
        assert all(low + 0.9 < value < high - 0.9 for trace in traces for value in trace[each] if value is not None)
    for figure in found.values():
        axes = [axis for key, axis in figure["layout"].items() if key[1:5] == "axis"]  # type: ignore[attr-defined]
        assert all("[" in axis["title"]["text"] for axis in axes)


def test_report_is_the_same_each_time(annotated: Path, page: Path, cwcli: Run, tmp_path: Path) -> None:
    assert cwcli("report", annotated, "-o", "again.html", env={"PYTHONHASHSEED": "7"}).returncode == 0
    assert (tmp_path / "again.html").read_bytes() == page.read_bytes()


def test_policy_allows_the_two_scripts_and_nothing_else(page: Path) -> None:
    (policy,) = (
        each["content"] for each in Elements(page.read_text()).of("meta") if "Policy" in each.get("http-equiv", "")
    )
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in policy
    assert policy.count("'sha256-") == 2
    assert "http" not in policy.replace("'", "")


def test_standard_output_and_json(annotated: Path, page: Path, cwcli: Run, tmp_path: Path) -> None:
    piped = cwcli("report", annotated, "-o", "-")
    assert piped.stdout == page.read_bytes()
    said = json.loads(cwcli("report", annotated, "-o", "r.html", "--json").stdout)
    assert said["bytes"] == (tmp_path / "r.html").stat().st_size
    assert said["logs"] == said["with_figures"] == 1


def test_errors_are_one_line(annotated: Path, cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.mcap").write_bytes(b"no log")
    (tmp_path / "there.html").touch()
    for arguments, code in (
        (("empty", "-o", "r.html"), EXIT_BAD_INPUT),
        (("broken.mcap", "-o", "r.html"), EXIT_BAD_INPUT),
        (("missing.mcap", "-o", "r.html"), EXIT_BAD_INPUT),
        ((annotated, "-o", "there.html"), EXIT_NOT_WRITTEN),
        ((annotated, "-o", "r.html", "--gate", "__import__('os')"), EXIT_USAGE),
    ):
        done = cwcli("report", *arguments)
        assert done.returncode == code, done.stderr
        assert done.stderr.startswith(b"error: ")
        assert b"Traceback" not in done.stderr
        assert not (tmp_path / "r.html").exists()


def test_missing_library_is_named(annotated: Path, cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "shadow").mkdir()
    (tmp_path / "shadow" / "jinja2.py").write_text("raise ModuleNotFoundError('jinja2', name='jinja2')")
    root = str(Path(__file__).parents[2])
    path = os.pathsep.join([str(tmp_path / "shadow"), root])
    done = cwcli("report", annotated, "-o", "r.html", env={"PYTHONPATH": path})
    assert done.returncode == EXIT_USAGE
    assert b"pip install 'cwcli-drive[report]'" in done.stderr


def test_gates_are_judged_and_do_not_change_the_exit_code(annotated: Path, cwcli: Run, tmp_path: Path) -> None:
    gates = ("--gate", "ego.position_rmse_m < 0.5", "--gate", "warnings.count < 1")
    assert cwcli("report", annotated, "-o", "r.html", *gates).returncode == 0
    text = (tmp_path / "r.html").read_text()
    assert "1 of 2 gates failed" in text
    assert text.index("warnings.count &lt; 1") < text.index("ego.position_rmse_m &lt; 0.5")


def hostile(source: Path, target: Path) -> None:
    """The log with evil names: the other vehicle, the rule, and in the records topics, roles and reasons."""
    with Log.open(source) as log:
        channels = []
        for topic, schema in (
            ("/cwcli/remote/state", "cwcli.v1.VehicleState"),
            ("/cwcli/warnings", "cwcli.v1.Warning"),
        ):
            columns = log.columns(topic)
            fields = dict(columns.fields)
            for name in ("id", "other_id", "rule", "message"):
                values = fields.get(name)
                if isinstance(values, Strings):
                    text = EVIL_ID if name in {"id", "other_id"} else EVIL
                    fields[name] = Strings(values.codes, tuple(text for _ in values.values))
            channels.append(OutputChannel(topic, schema, columns.log_time_ns, fields))
        counts = [{"topic": EVIL, "role": EVIL, "read": 1, "used": EVIL, "rejected": {EVIL: 1}, "repaired": {}}]
        record = {
            "counts": json.dumps(counts),
            "configuration": json.dumps({"rule": {"rule": EVIL, "distance_m": EVIL}}),
        }
        annotate_log(log, channels, {f"cwcli.run.{SHORT_EVIL}": record}, target, replace=True)


def test_hostile_text_runs_nothing(annotated: Path, tmp_path: Path, cwcli: Run) -> None:
    out = tmp_path / SHORT_EVIL.replace("/", "_")
    identity = SHORT_EVIL
    (out / "logs" / identity).mkdir(parents=True)
    hostile(annotated, out / "logs" / identity / "annotated.mcap")
    error = {"what": EVIL, "where": EVIL, "hint": EVIL, "exit_code": 3}
    entries = [
        {"id": identity, "source": EVIL, "status": "done", "left_out": {EVIL: EVIL, "warn": EVIL}, "error": None},
        {"id": EVIL, "source": EVIL, "status": "failed", "left_out": {}, "error": error},
    ]
    (out / "manifest.json").write_text(json.dumps({"format": 2, "pipeline": {}, "logs": entries}))
    done = cwcli("report", out, "-o", "r.html")
    assert done.returncode == 0, done.stderr
    assert b"\x1b" not in done.stderr + done.stdout
    html = (tmp_path / "r.html").read_text()
    elements = Elements(html)
    assert len(elements.of("script")) == 2 + len(figures(html))
    assert [each["src"] for each in elements.of("img") if not each["src"].startswith("data:image/jpeg")] == []
    assert all(OWN_ADDRESS.fullmatch(each["href"]) for each in elements.of("a"))
    assert not any(name.startswith("on") for _, attributes in elements.found for name in attributes)
    assert "\u202e" not in html
    assert "\x1b" not in html
    assert "{{7*7}}" in html  # it is shown, and no template makes 49 of it
    visited = visit(tmp_path / "r.html", tmp_path)
    assert drawn(visited) >= 3
    assert "data-pwned" not in visited.dom.split("<head>")[0]
    assert visited.console == ()
    shown = Elements(visited.dom)
    addresses = [attributes.get(name, "") for _, attributes in shown.found for name in ("href", "xlink:href", "src")]
    assert not any("javascript:" in address for address in addresses)
    assert not any(name.startswith("on") for _, attributes in shown.found for name in attributes)
    assert all(each["src"].startswith("data:") for each in shown.of("img"))
    assert all(OWN_ADDRESS.fullmatch(each["href"]) for each in shown.of("a") if "modebar-btn" not in str(each))
    assert "vehicle &lt;a href=" in visited.dom  # it is shown as what it is


def with_camera(source: Path, target: Path) -> None:
    """The log with a camera at 10 Hz, whose frames get brighter by one grey level each, and lanes found in them."""
    with Log.open(source) as log:
        times = log.start_ns + np.arange(100) * 100_000_000
        files = [encode_jpeg(np.full((96, 128, 3), 100 + k, np.uint8)) for k in range(100)]
        offsets = np.concatenate([[0], np.cumsum([len(each) for each in files])]).astype(np.int64)
        images: dict[str, Any] = {
            "timestamp": times,
            "data": Ragged(np.concatenate(files), offsets),
            "format": Strings(np.zeros(100, np.int32), ("jpeg",)),
        }
        lanes: dict[str, Any] = {
            "stamp_ns": times,
            "search_width_px": np.full(100, 64),
            "search_height_px": np.full(100, 48),
        }
        for side, foot in (("left", 10.0), ("right", 54.0)):
            for name, value in (("a", 0.0), ("b", 0.0), ("c", foot)):
                lanes[f"{side}.{name}"] = np.full(100, value)
            for name in ("far_px", "near", "bend_px2"):  # as of a method without a horizon of its own
                lanes[f"{side}.{name}"] = np.full(100, np.nan)
            lanes[f"{side}.found"] = np.arange(100) != 47 if side == "left" else np.ones(100, bool)
        for name in ("lateral_deviation_m", "heading_deviation_rad", "curvature_1pm"):
            lanes[name] = np.zeros(100)
        for name in ("horizon_px", "top_px"):
            lanes[name] = np.full(100, np.nan)
        channels = [
            OutputChannel("/camera/image", "foxglove.CompressedImage", times, images),
            OutputChannel("/cwcli/lanes", "cwcli.v1.Lanes", times, lanes),
        ]
        annotate_log(log, channels, {}, target)


def test_camera_frames_around_the_warning_have_their_lanes(annotated: Path, cwcli: Run, tmp_path: Path) -> None:
    with_camera(annotated, tmp_path / "seen.mcap")
    assert cwcli("report", "seen.mcap", "-o", "r.html").returncode == 0
    html = (tmp_path / "r.html").read_text()
    pictures = [each for each in Elements(html).of("img") if "marked moment" not in each["alt"]]
    # the warning came at 4.700 s: frames 27, 37, 47, 57, 67
    assert [each["alt"].split(":")[0] for each in pictures] == [
        f"Camera frame at {at} s" for at in ("2.70", "3.70", "4.70", "5.70", "6.70")
    ]
    assert [each["alt"].rpartition(", ")[2] for each in pictures] == [
        f"{what} found"
        for what in ("both lane boundaries", "both lane boundaries", "one lane boundary", *["both lane boundaries"] * 2)
    ]
    for each, grey in zip(pictures, (127, 137, 147, 157, 167), strict=True):
        data = base64.b64decode(each["src"].removeprefix("data:image/jpeg;base64,"))
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None and image.shape == (240, 320, 3)
        assert abs(int(image[120, 160].mean()) - grey) <= 3
        assert image[200, round(54 / 64 * 320)].tolist() != [grey] * 3  # the right line
        assert int(image[200, round(54 / 64 * 320) - 3 : round(54 / 64 * 320) + 3].max()) > 200
    assert "log-1-lane" in figures(html)


def test_log_without_results_is_refused_with_a_hint(cwcli: Run) -> None:
    done = cwcli("report", SAMPLES / "straight.mcap", "-o", "r.html")
    assert done.returncode == EXIT_MISSING_SIGNAL
    assert b"cwcli run" in done.stderr


def test_folder_of_logs_shows_the_failed_one_first(cwcli: Run, tmp_path: Path) -> None:
    (tmp_path / "zz-broken.mcap").write_bytes(b"no log")
    for name in ("intersection", "straight"):
        shutil.copy(SAMPLES / f"{name}.mcap", tmp_path)
    logs = [tmp_path / name for name in ("intersection.mcap", "straight.mcap", "zz-broken.mcap")]
    assert cwcli("run", *logs, "-d", "out", "--quiet").returncode == EXIT_BAD_INPUT
    assert cwcli("report", "out", "-o", "r.html").returncode == 0
    text = (tmp_path / "r.html").read_text()
    rows = [text.index(f">{name}</") for name in ("zz-broken", "intersection", "straight")]
    assert rows == sorted(rows)
    assert "3 drives: cwcli gave 1 warning in 1 of them; 1 could not be processed." in text
    assert "it is not an MCAP file" in text
    table = text.partition('class="wide logs"')[2].partition("</table>")[0]
    tracks = [re.findall(r'<svg class="track".*?<path d="M([^"]+)"', row) for row in table.split("<tr>")[2:]]
    assert [len(each) for each in tracks] == [0, 1, 1]  # the failed one has none
    assert len({point.split()[0] for point in tracks[1][0].split("L")}) == 1  # it goes straight north


def test_page_of_many_logs_keeps_to_its_size_and_says_what_is_left_out(
    annotated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cwcli.report import build

    entries = []
    for index in range(12):
        name = f"log{index:02d}"
        (tmp_path / "logs" / name).mkdir(parents=True)
        (tmp_path / "logs" / name / "annotated.mcap").symlink_to(annotated)
        entries.append({"id": name, "source": name, "status": "done"})
    (tmp_path / "manifest.json").write_text(json.dumps({"logs": entries}))
    monkeypatch.setattr(build, "MAX_PAGE_BYTES", 2_200_000)
    report = build.build_report(str(tmp_path))
    assert len(report.html) < 2_200_000
    assert 0 < report.n_detailed < 12
    assert len(report.left_out) == 12 - report.n_detailed
    assert f"{len(report.left_out)} of the 12 logs are in the table only" in report.html.decode()
    assert report.html.count(b'<svg class="track"') == 12
    monkeypatch.setattr(build, "MAX_LOGS_OPENED_FOR_OVERVIEW", 1)  # of more, those with figures alone have a track
    report = build.build_report(str(tmp_path))
    assert report.html.count(b'<svg class="track"') == report.n_detailed > 0


def test_ten_minutes_stay_under_six_megabytes(annotated: Path, tmp_path: Path) -> None:
    """A log of ten minutes: 12,000 states that shake, a warning every ten seconds."""
    target = tmp_path / "long.mcap"
    long_log(annotated, target)
    from cwcli.report.build import build_report

    report = build_report(str(target))
    assert len(report.html) < 6_000_000
    assert len(report.html) < MAX_PAGE_BYTES
    motion = figures(report.html.decode())["log-1-motion"]
    assert "12060 states are drawn as the least and the largest value" in report.html.decode()
    speeds = [trace for trace in motion["data"] if trace["name"] == "estimated"]  # type: ignore[attr-defined]
    assert math.isclose(max(value for value in speeds[0]["y"] if value is not None), 99.0)


def long_log(source: Path, target: Path) -> None:
    """The intersection sixty times over, each ten seconds later, with one spike of the speed."""
    step_ns = 10_050_000_000
    rng = np.random.default_rng(1)
    with Log.open(source) as log:
        channels = []
        for topic, schema in (
            ("/cwcli/ego/state", "cwcli.v1.VehicleState"),
            ("/cwcli/remote/state", "cwcli.v1.VehicleState"),
            ("/cwcli/warnings", "cwcli.v1.Warning"),
        ):
            columns = log.columns(topic)
            times = np.concatenate([columns.log_time_ns + k * step_ns for k in range(60)])
            fields: dict[str, Any] = {}
            for name, values in columns.fields.items():
                if isinstance(values, Strings):
                    fields[name] = Strings(np.tile(values.codes, 60), values.values)
                elif isinstance(values, np.ndarray):
                    fields[name] = np.concatenate([values] * 60)
                else:
                    fields[name] = np.tile(values.values, 60).reshape(60 * len(values), -1)
            fields["stamp_ns"] = np.concatenate(
                [np.asarray(columns.fields["stamp_ns"]) + k * step_ns for k in range(60)]
            )
            if "event_id" in fields:
                n = len(columns)
                fields["event_id"] = fields["event_id"] + np.repeat(np.arange(60), n)
            else:
                for name in ("speed_mps", "heading_rad", "yaw_rate_radps", "accel_mps2"):
                    fields[name] = fields[name] + rng.normal(scale=0.3, size=len(times))
                if topic == "/cwcli/ego/state":
                    fields["speed_mps"][7_777] = 99.0
            channels.append(OutputChannel(topic, schema, times, fields))
        annotate_log(log, channels, {}, target, replace=True)
        assert columns_of_added_channel(channels[0], ["stamp_ns"]).fields
