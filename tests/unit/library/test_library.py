"""Logs, runs and results for Python programs: the same as the commands, silent, and never half written."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import cwcli
from cwcli.cli import main
from cwcli.logs.read.reader import Log
from cwcli.logs.write.record_writer import RecordWriter

ROOT = Path(__file__).parents[3]
SAMPLES = ROOT / "sample_logs"
INTERSECTION = SAMPLES / "intersection.mcap"


def names_in(folder: str = ".") -> list[str]:
    """Names of the files and folders in a folder, sorted."""
    return sorted(path.name for path in Path(folder).iterdir())


def assert_same_rows(table: pa.Table, other: pa.Table) -> None:
    """Compare two tables, NaN equal to NaN, but for the counter of messages, which a writer sets."""
    ours, theirs = (each.drop_columns("sequence") for each in (table, other))
    assert ours.schema.equals(theirs.schema)
    assert repr(ours.to_pydict()) == repr(theirs.to_pydict())


@pytest.fixture(scope="module")
def result() -> cwcli.Result:
    """Every table of the intersection."""
    return cwcli.open(INTERSECTION).run("estimate", "predict", "warn", "measure")


@pytest.fixture(autouse=True)
def without_configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run in an empty folder."""
    monkeypatch.chdir(tmp_path)


def test_a_saved_result_is_byte_for_byte_what_the_command_writes(result: cwcli.Result, tmp_path: Path) -> None:
    assert result.save("ours.mcap", tables="ours") == [
        Path("ours.mcap"),
        *(Path("ours") / f"{name}.parquet" for name in result.scores),
    ]
    arguments = ["run", str(INTERSECTION), "--stage", "estimate,predict,warn,measure", "-q"]
    assert main.run_command_line([*arguments, "-o", "theirs.mcap", "--metrics-dir", "theirs"]) == 0
    assert Path("ours.mcap").read_bytes() == Path("theirs.mcap").read_bytes()
    names = names_in("theirs")
    assert (names_in("ours")) == names
    assert all((Path("ours") / name).read_bytes() == (Path("theirs") / name).read_bytes() for name in names)


def test_options_are_those_of_the_command() -> None:
    options: dict[str, dict[str, Any]] = {
        "estimate": {"rate": 10, "lever_arm": ["/gps/fix=1.0,0.5"]},
        "predict": {"horizon": 3},
    }
    cwcli.open(INTERSECTION, start=2, end="8").run("estimate", "predict", options=options).save("ours.mcap")
    flags = "--estimate-rate 10 --estimate-lever-arm /gps/fix=1.0,0.5 --predict-horizon 3 --start 2 --end 8"
    run = ["run", str(INTERSECTION), "--stage", "estimate,predict", *flags.split(), "-q", "-o", "theirs.mcap"]
    assert main.run_command_line(run) == 0
    assert Path("ours.mcap").read_bytes() == Path("theirs.mcap").read_bytes()


def test_without_names_what_can_run_runs_and_the_rest_is_told() -> None:
    made = cwcli.open(SAMPLES / "straight.mcap").run()
    assert "estimate" in made.stages or "lanes" in made.stages
    assert set(made.left_out).isdisjoint(made.stages)
    assert made.left_out


def test_tables_hold_the_channels_with_units_and_signed_times(result: cwcli.Result, tmp_path: Path) -> None:
    assert isinstance(result.ego, pa.Table)
    for table in (result.ego, result.others, result.warnings, result.measures):
        times = [field for field in table.schema if field.name.endswith("_ns")]
        assert {"log_time_ns", "stamp_ns"} <= {field.name for field in times}
        assert {field.type for field in times} == {pa.int64()}
        assert table.num_rows
    assert result.ego.schema.field("speed_mps").metadata[b"unit"] == b"m/s"
    result.save("saved.mcap")
    with Log.open("saved.mcap") as log:
        columns = log.columns("/cwcli/ego/state")
        assert np.array_equal(result.ego["x_m"].to_numpy(), np.asarray(columns.fields["x_m"]))
        assert np.array_equal(result.ego["stamp_ns"].to_numpy(), np.asarray(columns.fields["stamp_ns"]))
    assert_same_rows(cwcli.open("saved.mcap").table("/cwcli/ego/state"), result.ego)
    assert result.table("/cwcli/ego/online").num_rows == result.ego.num_rows
    recorded = cwcli.open(INTERSECTION).table("/gps/fix")
    assert result.table("/gps/fix")["latitude"].to_pylist() == recorded["latitude"].to_pylist()


def test_a_log_without_other_vehicles_has_a_table_without_rows() -> None:
    made = cwcli.open(INTERSECTION, topics={"remote": "/v2x/bsm"}, end=0.2).run("estimate")
    alone = cwcli.open(SAMPLES / "curve.mcap").run("estimate")
    assert alone.others.num_rows == 0
    assert set(alone.others.column_names) == set(made.ego.column_names)


def test_doubts_are_those_of_the_digest_and_stay_readable_after_the_log_is_closed() -> None:
    in_km_per_h = "/vehicle/velocity:longitudinal_velocity*3.6"
    with cwcli.open(INTERSECTION, topics={"ego_speed": in_km_per_h}) as log:
        made = log.run("estimate")
    assert made.doubts.num_rows
    worst = made.doubts.to_pylist()[0]
    assert worst["name"] == "contradiction"
    assert "/vehicle/velocity" in worst["sentence"]
    assert worst["value"] >= worst["threshold"]
    without = cwcli.open(SAMPLES / "curve.mcap").run("estimate").doubts
    assert without.num_rows == 0
    assert without.schema == made.doubts.schema


def test_a_table_of_a_stage_that_did_not_run_says_which_one() -> None:
    made = cwcli.open(INTERSECTION).run("estimate")
    with pytest.raises(cwcli.MissingSignalError, match="there is no channel /cwcli/warnings") as caught:
        made.warnings  # noqa: B018 - the access is the test
    assert caught.value.hint == 'run its stage: log.run("warn")'


def test_a_stage_sees_the_channels_of_an_annotated_log(result: cwcli.Result) -> None:
    result.save("annotated.mcap")
    again = cwcli.open("annotated.mcap").run("measure")
    assert_same_rows(again.measures, result.measures)
    with pytest.raises(cwcli.OutputError, match="already"):
        again.save("again.mcap")
    assert again.save("again.mcap", replace=True) == [Path("again.mcap")]


def test_a_stage_that_others_precede_runs_them_first() -> None:
    made = cwcli.open(INTERSECTION).run("control")
    assert made.stages == ("estimate", "control")
    made.save("with.mcap")
    assert cwcli.open("with.mcap").run("control").stages == ("control",)


@pytest.mark.parametrize(
    ("call", "error", "what", "hint"),
    [
        (lambda log: log.run("estimat"), cwcli.UsageError, "there is no stage estimat", "did you mean estimate?"),
        (
            lambda log: log.run("estimate", options={"estimate": {"lattency": 1}}),
            cwcli.UsageError,
            "the stage estimate has no option lattency",
            "did you mean latency?",
        ),
        (
            lambda log: log.run("estimate", options={"estimate": {"rate": "10"}}),
            cwcli.UsageError,
            "estimate: rate = '10' must be a number",
            "",
        ),
        (
            lambda log: log.run("estimate", options={"estimate": {"causal": 1}}),
            cwcli.UsageError,
            "estimate: causal = 1 must be True or False",
            "",
        ),
        (
            lambda log: log.run("estimate", options={"estimate": {"lever_arm": "/gps/fix=1,0"}}),
            cwcli.UsageError,
            "estimate: lever_arm = '/gps/fix=1,0' must be a list",
            "",
        ),
        (
            lambda log: log.run("estimate", options={"estimate": {"model": "song2015"}}),
            cwcli.UsageError,
            "estimate: model = 'song2015' is not one of its values",
            "did you mean song2016?",
        ),
        (
            lambda log: log.run("estimate", options={"warn": {"rule": "ttc"}}),
            cwcli.UsageError,
            "options are given for the stage warn, which does not run",
            "run: estimate",
        ),
        (
            lambda log: log.run("predict", "estimate", options={"predict": {"horizon": -1.0}}),
            cwcli.UsageError,
            "a horizon of -1 s is not a positive number of seconds",
            None,
        ),
        (
            lambda log: log.run("track", options={"track": {"gate": 2}}),
            cwcli.UsageError,
            "--gate 2 must be above 0 and at most 1",
            "",
        ),
        (lambda log: log.run("lanes"), cwcli.MissingSignalError, "no channel holds the camera", None),
        (lambda log: log.run("estimate", clock="logg"), cwcli.UsageError, "there is no clock 'logg'", None),
        (lambda log: log.run("estimate", calibration="no.toml"), cwcli.InputError, "can't be read", None),
        (lambda log: log.table("/no"), cwcli.MissingSignalError, "there is no channel /no", ""),
        (lambda log: cwcli.open("no.mcap"), cwcli.InputError, "it can't be read: No such file or directory", ""),
        (
            lambda log: cwcli.open(log.name, topics={"ego_positio": "/gps/fix"}),
            cwcli.UsageError,
            "there is no role ego_positio",
            "did you mean ego_position?",
        ),
        (lambda log: cwcli.open(log.name, start=99), cwcli.UsageError, "--start 99 is after the end of the log", None),
        (lambda log: cwcli.simulate("intersecton", "x.mcap"), cwcli.CwcliError, "intersecton", None),
        (lambda log: cwcli.report(log.name, "x.html"), cwcli.MissingSignalError, "there is nothing to report", None),
    ],
)
def test_a_mistake_is_a_known_error(
    call: Callable[[cwcli.Log], object],
    error: type[cwcli.CwcliError],
    what: str,
    hint: str | None,
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(error) as caught:
        call(cwcli.open(INTERSECTION))
    assert what in caught.value.what
    if hint is not None:
        assert caught.value.hint == hint
    assert capfd.readouterr() == ("", "")
    assert not names_in()


def test_nothing_is_printed_and_progress_goes_where_it_is_asked_for(capfd: pytest.CaptureFixture[str]) -> None:
    steps: list[str] = []
    cwcli.simulate("rear-end", "drive.mcap", seed=2, values={"host.speed_mps": 15})
    made = cwcli.open("drive.mcap").run("estimate", "predict", "warn", progress=steps.append)
    made.save("annotated.mcap", tables="tables")
    cwcli.report("annotated.mcap", "page.html", gates=["ego.position_rmse_m < 5"])
    cwcli.report(made, "same.html", progress=steps.append)
    assert capfd.readouterr() == ("", "")
    assert [step.split()[0] for step in steps] == ["estimate", "predict", "warn", "report"]
    assert b"<html" in Path("same.html").read_bytes()
    assert (names_in()) == ["annotated.mcap", "drive.mcap", "page.html", "same.html", "tables"]


def test_an_interrupted_save_leaves_nothing_new(result: cwcli.Result, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("old.mcap").write_bytes(b"old")

    def interrupt(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(RecordWriter, "write_chunk", interrupt)
    for target in ("new.mcap", "old.mcap"):
        with pytest.raises(KeyboardInterrupt):
            result.save(target, tables="tables", force=True)
    with pytest.raises(KeyboardInterrupt):
        cwcli.report(result, "page.html")
    assert names_in() == ["old.mcap"]
    assert Path("old.mcap").read_bytes() == b"old"
    monkeypatch.undo()


def test_an_interrupted_run_leaves_a_log_that_can_be_run_again() -> None:
    log = cwcli.open(INTERSECTION)

    def interrupt(step: str) -> None:
        if step.startswith("predict"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        log.run("estimate", "predict", progress=interrupt)
    assert log.run("estimate", "predict").stages == ("estimate", "predict")


def test_a_closed_log_keeps_its_results_and_says_that_it_is_closed() -> None:
    with cwcli.open(INTERSECTION) as log:
        made = log.run("estimate")
    assert made.ego.num_rows
    for call in (lambda: made.save("x.mcap"), lambda: made.table("/gps/fix"), lambda: log.run("estimate")):
        with pytest.raises(cwcli.UsageError, match="the log is closed"):
            call()
    assert not names_in()


def test_the_input_is_never_overwritten(tmp_path: Path) -> None:
    cwcli.simulate("rear-end", "drive.mcap")
    before = Path("drive.mcap").read_bytes()
    made = cwcli.open("drive.mcap").run("estimate")
    with pytest.raises(cwcli.OutputError, match="the output is the input itself"):
        made.save("drive.mcap", force=True)
    with pytest.raises(cwcli.OutputError, match="the file exists"):
        cwcli.simulate("rear-end", "drive.mcap")
    assert Path("drive.mcap").read_bytes() == before


def test_a_log_that_changes_while_it_is_read_is_refused() -> None:
    cwcli.simulate("rear-end", "drive.mcap")
    log = cwcli.open("drive.mcap")
    with Path("drive.mcap").open("ab") as file:
        file.write(b"more")
    with pytest.raises(cwcli.InputError, match="the log changed while it was read"):
        log.run("estimate")


def test_the_memory_of_the_callers_arrays_is_as_before(result: cwcli.Result) -> None:
    multiarray: Any = import_module("numpy._core.multiarray")
    before = multiarray.get_handler_name()
    cwcli.open(INTERSECTION).run("estimate").save("x.mcap")
    assert multiarray.get_handler_name() == before == multiarray.get_handler_name(np.zeros(1))


def test_a_dash_is_the_name_of_a_file(result: cwcli.Result, capfd: pytest.CaptureFixture[str]) -> None:
    result.save("-")
    assert names_in() == ["-"]
    assert capfd.readouterr() == ("", "")
