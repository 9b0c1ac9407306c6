"""`cwcli view`, and Rerun's own converter: paths, fixes and logs of an annotated log are found and drawn.

Whether Rerun draws an entity in a spatial view is a matter of frames (https://rerun.io/docs/concepts/transforms):
each entity has one, named or its path's own, and is drawn where a chain of transforms leads from it to the view's.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_MISSING_SIGNAL, EXIT_USAGE
from cwcli.export.recording import MAX_RERUN_TIME_NS
from cwcli.logs.read.reader import Log
from tests.cli import rewritten_logs

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 600
TIMELINE = "message_log_time"
ROW_ID = "rerun.controls.RowId"
"""Rerun's column of ids that hold the time of the clock and a random number."""
ATOL_DEG = 1e-12

Run = Callable[..., CompletedProcess[bytes]]
Columns = dict[str, list[Any]]


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundled log with states, paths and warnings."""
    target = tmp_path_factory.mktemp("rerun") / "annotated.mcap"
    source = ROOT / "sample_logs" / "intersection.mcap"
    subprocess.run([sys.executable, "-m", "cwcli", "run", str(source), "-o", str(target), "-q"], check=True, cwd=ROOT)
    return target


def rerun_environment(home: Path) -> dict[str, str]:
    """A home of its own, in which Rerun's usage data is off."""
    environment = {**os.environ, "HOME": str(home), "XDG_CONFIG_HOME": str(home), "XDG_DATA_HOME": str(home)}
    run_tool([rerun_tool(), "analytics", "disable"], environment)
    return environment


def rerun_tool() -> str:
    beside = Path(sys.executable).with_name("rerun")
    found = str(beside) if beside.exists() else shutil.which("rerun")
    assert found, "rerun-sdk has no command beside the interpreter"
    return found


def run_tool(command: list[str], environment: dict[str, str]) -> None:
    done = subprocess.run(command, capture_output=True, check=False, env=environment, timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stderr.decode()


def read_recording(path: Path) -> dict[str, Columns]:
    """Entity -> column -> values of the rows that have a log time, in order; then of those that hold for all times."""
    entities: dict[str, Columns] = defaultdict(lambda: defaultdict(list))
    batches = [(chunk.entity_path, chunk.to_record_batch()) for chunk in RrdReader(str(path)).store().stream()]
    for entity, batch in sorted(batches, key=lambda each: TIMELINE not in each[1].schema.names):
        for name in batch.schema.names:
            column = batch.column(name)
            entities[entity][name] += column.cast("int64").to_pylist() if name == TIMELINE else column.to_pylist()
    return entities


@dataclass(frozen=True)
class View:
    """Where a view of the blueprint looks from, and which entities it may show."""

    origin: str
    contents: list[str]

    def holds(self, entity: str) -> bool:
        return any(entity.startswith(each[:-2]) if each.endswith("**") else entity == each for each in self.contents)


def view_named(path: Path, name: str) -> View:
    reader = RrdReader(str(path))
    [blueprint] = reader.blueprints()
    rows = {chunk.entity_path: chunk.to_record_batch().to_pylist()[0] for chunk in reader.stream(store=blueprint)}
    [(entity, row)] = [each for each in rows.items() if each[1].get("ViewBlueprint:display_name") == [name]]
    return View(row["ViewBlueprint:space_origin"][0], rows[f"{entity}/ViewContents"]["ViewContents:query"])


def named_frames(columns: Columns) -> set[str]:
    """The frames that were said for an entity, now or once for all."""
    return {each[0] for each in columns.get("CoordinateFrame:frame", []) if each}


def root_frame(frame: str, parents: dict[str, str]) -> str:
    """Where the chain of transforms from a frame ends; an entity's own frame hangs on that of the entity above it."""
    while frame in parents or (frame.startswith("tf#/") and frame != "tf#/"):
        frame = parents.get(frame) or frame[: max(frame.rindex("/"), len("tf#/"))]
    return frame


def drawn_in(view: View, entities: dict[str, Columns]) -> set[str]:
    """Entities with something to draw in 3D whose frame leads to the view's."""
    parents = {
        child[0]: parent[0]
        for columns in entities.values()
        for child, parent in zip(
            columns.get("Transform3D:child_frame", []), columns.get("Transform3D:parent_frame", []), strict=True
        )
        if child and parent
    }
    held = {entity: columns for entity, columns in entities.items() if view.holds(entity)}
    roots = {root_frame(frame, parents) for columns in held.values() for frame in named_frames(columns)}
    own = named_frames(entities.get(view.origin, {}))  # else the named frames' root if there is but one
    target = root_frame(next(iter(own or roots)) if len(own or roots) == 1 else f"tf#{view.origin}", parents)
    return {
        entity
        for entity, columns in held.items()
        if {"LineStrips3D:strips", "TransformAxes3D:axis_length"} & columns.keys()
        and {root_frame(frame, parents) for frame in named_frames(columns) or {f"tf#{entity}"}} == {target}
    }


def in_time_order(columns: Columns, name: str) -> list[Any]:
    return [value for _, value in sorted(zip(columns[TIMELINE], columns[name], strict=True), key=lambda row: row[0])]


@pytest.fixture(scope="module")
def converted(annotated: Path) -> dict[str, Columns]:
    """What `rerun mcap convert` makes of the log."""
    target = annotated.with_suffix(".rrd")
    command = [rerun_tool(), "mcap", "convert", str(annotated), "-o", str(target)]
    run_tool(command, rerun_environment(annotated.parent))
    return read_recording(target)


def test_converter_finds_the_paths(annotated: Path, converted: dict[str, Columns]) -> None:
    with Log.open(annotated) as log:
        columns = log.columns("/cwcli/ego/path")
    messages = in_time_order(converted["/cwcli/ego/path"], "cwcli.v1.PredictedPath:message")
    assert len(messages) == len(columns) == 51
    expected = np.asarray(columns.fields["x_m"]).reshape(51, -1)
    assert np.array_equal([message[0]["x_m"] for message in messages], expected)
    assert len(converted["/cwcli/remote/path"][TIMELINE]) == 51
    assert len(converted["/cwcli/paths/scene"][TIMELINE]) > 100


def test_converter_puts_the_fixes_on_its_map(annotated: Path, converted: dict[str, Columns]) -> None:
    with Log.open(annotated) as log:
        columns = log.columns("/cwcli/ego/fix")
    positions = in_time_order(converted["/cwcli/ego/fix"], "GeoPoints:positions")
    found = np.array([each[0] if isinstance(each[0], list) else each for each in positions])
    expected = np.column_stack([np.asarray(columns.fields[name]) for name in ("latitude", "longitude")])
    np.testing.assert_allclose(found, expected, rtol=0, atol=ATOL_DEG)
    raw = in_time_order(converted["/gps/fix"], "GeoPoints:positions")
    assert len(raw) == 201


def test_converter_takes_the_warnings_as_a_text_log(converted: dict[str, Columns]) -> None:
    log = converted["/cwcli/log"]
    texts, levels = in_time_order(log, "TextLog:text"), in_time_order(log, "TextLog:level")
    assert "collision with d9583520" in texts[0][0]
    assert [level[0] for level in levels] == ["WARN", "INFO"]


def test_converter_finds_poses_and_transforms(converted: dict[str, Columns]) -> None:
    assert len(converted["/cwcli/ego/pose"]["InstancePoses3D:translations"]) == 51
    frames = {frame[0] for frame in converted["/cwcli/tf"]["Transform3D:child_frame"]}
    assert frames == {"base_link"}


@pytest.fixture(scope="module")
def recorded(annotated: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `cwcli view` makes of the log."""
    folder = tmp_path_factory.mktemp("view")
    target = folder / "annotated.rrd"
    command = [sys.executable, "-m", "cwcli", "view", str(annotated), "-o", str(target)]
    run_tool(command, rerun_environment(folder))
    return target


def test_view_draws_paths_and_speeds(annotated: Path, recorded: Path) -> None:
    with Log.open(annotated) as log:
        x_m = np.asarray(log.columns("/cwcli/ego/path").fields["x_m"]).reshape(51, -1)
    found = read_recording(recorded)
    strips = in_time_order(found["/paths/ego"], "LineStrips3D:strips")
    assert np.allclose([[point[0] for point in strip[0]] for strip in strips], x_m, rtol=0, atol=1e-4)
    assert len(found["/speed/d9583520"]["Scalars:scalars"]) == 201
    assert len(found["/cwcli/log"]["TextLog:text"]) == 2


def rows_but_for_their_ids(path: Path) -> tuple[str, list[str]]:
    """The recording's id, and its rows in an order of their own: Rerun imports a log's channels in threads."""
    reader = RrdReader(str(path))
    [recording] = reader.recordings()
    rows = []
    for chunk in reader.stream(store=recording):
        batch = chunk.to_record_batch().drop_columns([ROW_ID])
        rows += [f"{chunk.entity_path} {row}" for row in batch.to_pylist()]
    return recording.recording_id, sorted(rows)


def test_two_recordings_of_a_log_hold_the_same_and_no_time_of_the_clock(annotated: Path, recorded: Path) -> None:
    """The bytes differ in the ids that Rerun gives to rows, chunks and layouts (docs/viewers.md)."""
    again = recorded.with_name("again.rrd")
    command = [sys.executable, "-m", "cwcli", "view", str(annotated), "-o", str(again)]
    run_tool(command, rerun_environment(recorded.parent))
    assert rows_but_for_their_ids(again) == rows_but_for_their_ids(recorded)
    with Log.open(annotated) as log:
        first_ns = log.start_ns
    found = read_recording(recorded)
    assert found["/__properties"]["RecordingInfo:start_time"] == [[first_ns]]
    assert [entity for entity, columns in found.items() if "log_time" in columns] == []


def test_log_that_begins_after_the_last_time_of_rerun_gives_a_recording_without_a_start(
    annotated: Path, tmp_path: Path
) -> None:
    messages = rewritten_logs.read(annotated)
    later_ns = MAX_RERUN_TIME_NS + 2 - messages[0].log_time_ns
    late, target = tmp_path / "late.mcap", tmp_path / "late.rrd"
    rewritten_logs.write(late, (replace(each, log_time_ns=each.log_time_ns + later_ns) for each in messages))
    run_tool([sys.executable, "-m", "cwcli", "view", str(late), "-o", str(target)], rerun_environment(tmp_path))
    found = read_recording(target)
    assert "RecordingInfo:start_time" not in found["/__properties"]
    assert len(found["/speed/d9583520"]["Scalars:scalars"]) == 201


def test_main_view_draws_the_paths_and_the_ego(recorded: Path) -> None:
    view = view_named(recorded, "From above")
    assert drawn_in(view, read_recording(recorded)) == {"/paths/ego", "/paths/d9583520", "/cwcli/ego/pose"}


def test_frames_decide_what_is_drawn() -> None:
    """By hand: a path in a frame of its own is not in the view of another, but for a transform that links them."""
    view = View("/", ["/paths/**"])
    path: Columns = {"LineStrips3D:strips": [[]]}
    said: Columns = {"CoordinateFrame:frame": [["map"]]}
    assert drawn_in(view, {"/paths/a": path}) == {"/paths/a"}
    assert drawn_in(view, {"/paths/a": path, "/": said}) == set()
    assert drawn_in(view, {"/paths/a": path, "/paths/b": said}) == set()
    assert drawn_in(view, {"/paths/a": path | said, "/": said, "/other": path | said}) == {"/paths/a"}
    body: Columns = {"CoordinateFrame:frame": [["base_link"]]}
    link: Columns = {"Transform3D:child_frame": [["base_link"]], "Transform3D:parent_frame": [["map"]]}
    assert drawn_in(view, {"/paths/a": path | body, "/": said}) == set()
    assert drawn_in(view, {"/paths/a": path | body, "/": said, "/tf": link}) == {"/paths/a"}


def test_what_can_not_be_shown_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str], annotated: Path) -> None:
    target = tmp_path / "x.rrd"
    raw = ROOT / "sample_logs" / "straight.mcap"
    assert run_command_line(["view", str(raw), "-o", str(target)]) == EXIT_MISSING_SIGNAL
    assert "run `cwcli run` first" in capsys.readouterr().err
    assert run_command_line(["view", str(annotated), "-o", str(tmp_path / "x.mcap")]) == EXIT_USAGE
    assert "a recording ends in .rrd" in capsys.readouterr().err
    assert run_command_line(["view", "-", "-o", str(target)]) == EXIT_USAGE
    assert list(tmp_path.iterdir()) == []
