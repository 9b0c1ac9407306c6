"""What the commands say of stages and options that do not exist."""

from __future__ import annotations

from pathlib import Path

import pytest

from cwcli.cli import main
from cwcli.cli.options.entries import option_entries_of_stage
from cwcli.cli.options.stage import make_stage_options_class
from cwcli.pipeline.stage import Stage
from cwcli.stages import STAGES
from tests.cli.conftest import Run
from tests.unit.stages.lateral_logs import drive, write_lane_log


@pytest.fixture(scope="module")
def lanes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_lane_log(tmp_path_factory.mktemp("lanes") / "lanes.mcap", drive(seconds=6.0, drift_mps=0.5))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("predict --from observer", "no such option: --from"),
        ("warn --source targets", "no such option: --source"),
        ("warn --rules lane-departure", "there is no warning rule 'lane-departure'"),
        ("warn --line-crossing 0.5", "no such option: --line-crossing"),
        ("warn-lane --lane-speed 20", "no such option: --lane-speed"),
        ("run --predict-from observer", "no such option: --predict-from"),
    ],
)
def test_an_option_of_another_stage_is_refused(cwcli: Run, lanes: Path, arguments: str, words: str) -> None:
    command, *options = arguments.split()
    done = cwcli(command, lanes, *options)
    assert done.returncode == 2
    assert words in done.stderr.decode()


def test_both_kinds_of_warnings_go_into_one_channel(cwcli: Run, lanes: Path, tmp_path: Path) -> None:
    stages = "--stage observe,predict-lane --stage warn --stage warn-lane"
    done = cwcli("run", lanes, *stages.split(), "-o", "out.mcap", "--metrics-dir", "tables")
    assert done.returncode == 0, done.stderr.decode()
    assert "warn was left out" in done.stderr.decode() + done.stdout.decode()


@pytest.mark.parametrize("key", ["origin", "calibrate"])
def test_a_key_of_another_stage_is_refused(cwcli: Run, tmp_path: Path, key: str) -> None:
    (tmp_path / "p.toml").write_text(f'[predict]\n{key} = "observer"\n')
    done = cwcli("config", "p.toml")
    assert done.returncode == 2
    assert f"unknown key predict.{key}" in done.stderr.decode()


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
