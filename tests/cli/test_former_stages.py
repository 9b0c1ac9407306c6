"""Stages that were options of others: the old spellings make the same files, and say what replaces them."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from cwcli.cli import main
from cwcli.cli.options.stage import make_stage_options_class, option_entries_of_stage
from cwcli.pipeline.stage import Stage
from cwcli.stages import STAGES
from tests.cli.conftest import Run
from tests.unit.stages.lateral_logs import drive, write_lane_log

FROM_OBSERVER = "`predict --from observer` is the stage `predict-lane` now"
LANE_DEPARTURE = "`warn --rules lane-departure` is the stage `warn-lane` now"


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_lane_log(tmp_path_factory.mktemp("lanes") / "lanes.mcap", drive(seconds=6.0, drift_mps=0.5))


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.suffix in (".mcap", ".parquet")}


def notes(stderr: bytes) -> str:
    return " ".join(stderr.decode().split())


def same(cwcli: Run, tmp_path: Path, source: Path, old: str, new: str, **settings: dict[str, str]) -> bytes:
    """Run both spellings; their files must be the same. Returns what the old one says."""
    said = b""
    for name, words in (("new", new), ("old", old)):
        (tmp_path / name).mkdir()
        command, *options = words.split()
        target = ["-o", f"{name}/out.mcap", "--metrics-dir", name]
        done = cwcli(command, source, *options, *target, **(settings if name == "old" else {}))
        assert done.returncode == 0, done.stderr.decode()
        said = done.stderr
    assert files(tmp_path / "old") == files(tmp_path / "new")
    assert len(files(tmp_path / "old")) > 1
    return said


def test_predict_from_the_observer(cwcli: Run, lanes: Path, tmp_path: Path) -> None:
    assert cwcli("observe", lanes, "-o", "observed.mcap").returncode == 0
    old = "predict --from observer --horizon 2 --no-calibrate --model lateral-zhang2011"
    new = "predict-lane --horizon 2 --no-calibrate --model lateral-zhang2011"
    said = notes(same(cwcli, tmp_path, tmp_path / "observed.mcap", old, new))
    assert said.count(FROM_OBSERVER) == 1


def test_warn_of_targets(cwcli: Run, predicted: Path) -> None:
    """The log has no targets: both spellings miss them alike."""
    old, new = cwcli("warn", predicted, "--source", "targets"), cwcli("warn-targets", predicted)
    assert (old.returncode, new.returncode) == (4, 4)
    assert old.stderr.endswith(new.stderr)
    assert "`warn --source targets` is the stage `warn-targets` now" in notes(old.stderr)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "run --predict-from observer --predict-horizon 2 --warn-rules lane-departure --warn-line-crossing 1",
            "run --stage estimate,track,lanes,observe,predict-lane,warn-lane --predict-lane-horizon 2 "
            "--warn-lane-line-crossing 1",
        ),
        (
            "run --predict-from observer --warn-rules cwcli,lane-departure --warn-horizon 3",
            "run --stage observe,predict-lane --stage warn --stage warn-lane --warn-horizon 3",
        ),
    ],
)
def test_options_of_run(cwcli: Run, lanes: Path, tmp_path: Path, old: str, new: str) -> None:
    said = notes(same(cwcli, tmp_path, lanes, old, new))
    assert said.count("note: `") == 1
    assert f"{FROM_OBSERVER}; {LANE_DEPARTURE}" in said


def test_both_kinds_of_warnings_in_one_channel(cwcli: Run, predicted: Path, tmp_path: Path) -> None:
    """A rule for which the log lacks a channel is left out if another one can run."""
    said = notes(same(cwcli, tmp_path, predicted, "warn --rules lane-departure,ttc", "warn --rules ttc"))
    assert LANE_DEPARTURE in said
    assert "warn-lane was left out: no channel holds the path from the observer" in said


def test_keys_of_a_pipeline_file_and_the_environment(cwcli: Run, lanes: Path, tmp_path: Path) -> None:
    old = '[predict]\norigin = "observer"\nhorizon = 2.0\ncalibrate = false\n[warn]\nrules = "lane-departure"\n'
    (tmp_path / "old.toml").write_text(old)
    printed = cwcli("config", "old.toml")
    assert printed.returncode == 0
    assert f"{FROM_OBSERVER}; {LANE_DEPARTURE}" in notes(printed.stderr)
    (tmp_path / "new.toml").write_bytes(printed.stdout)
    new = tomllib.loads(printed.stdout.decode())
    assert new["run"]["stages"] == ["estimate", "track", "lanes", "observe", "predict-lane", "warn-lane"]
    assert (new["predict-lane"]["horizon"], new["predict-lane"]["calibrate"]) == (2.0, False)
    assert not {"origin", "calibrate", "render"} & set(new["predict"])
    assert cwcli("config", "new.toml").stdout == printed.stdout
    run = f"run --config {tmp_path}/"
    said = notes(same(cwcli, tmp_path, lanes, f"{run}old.toml", f"{run}new.toml"))
    assert LANE_DEPARTURE in said
    environment = {"CWCLI_PREDICT_ORIGIN": "observer", "CWCLI_WARN_RULES": "lane-departure"}
    document = json.loads(cwcli("config", "--json", env=environment).stdout)
    assert document["run"]["stages"] == new["run"]["stages"]


@pytest.mark.parametrize("old", ["warn-lane --lane-speed 20", "warn --rules lane-departure --lane-speed 20"])
def test_an_option_of_another_name(cwcli: Run, lanes: Path, tmp_path: Path, old: str) -> None:
    assert cwcli("run", lanes, "--stage", "observe,predict-lane", "-o", "paths.mcap").returncode == 0
    said = notes(same(cwcli, tmp_path, tmp_path / "paths.mcap", old, "warn-lane --min-speed 20"))
    assert said.count(f"`{old.split(maxsplit=1)[0]} --lane-speed` is `--min-speed` now") == 1


def test_an_option_that_went_with_a_stage_is_not_used_without_it(cwcli: Run, predicted: Path) -> None:
    done = cwcli("warn", predicted, "--line-crossing", "0.5")
    assert done.returncode == 0
    assert "line_crossing of `warn` is an option of another stage now, and is not used" in notes(done.stderr)


def test_a_stage_that_is_not_installed_is_named_and_nothing_is_written(cwcli: Run, lanes: Path, tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_text('[run]\nstages = ["observe", "warn-lanes"]\n')
    for arguments in (("run", lanes, "-d", "out"), ("run", lanes, "-o", "out.mcap")):
        done = cwcli(*arguments, "--config", "p.toml")
        assert done.returncode == 2
        assert done.stderr.decode().startswith("error: there is no stage warn-lanes\n  hint:  did you mean warn-lane")
    assert [path.name for path in tmp_path.iterdir()] == ["p.toml"]


def test_a_stage_whose_module_is_missing_is_exit_code_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], intersection: Path, tmp_path: Path
) -> None:
    monkeypatch.setitem(STAGES, "track", Stage("track", "Gone.", package="cwcli.nowhere"))
    option_entries_of_stage.cache_clear()
    make_stage_options_class.cache_clear()
    for command in ("track", "run"):
        assert main.run_command_line([command, str(intersection), "-o", str(tmp_path / "out.mcap")]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err == (
            "error: the stage track can't be loaded: there is no module cwcli.nowhere\n  hint:  install cwcli again\n"
        )
    assert not list(tmp_path.iterdir())
