"""A stage or a command whose module is missing, or is no stage, is one clear line; nothing is written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from cwcli.errors import EXIT_USAGE
from tests.recipes.house import SAMPLES, House

Run = Callable[..., CompletedProcess[bytes]]
INTERSECTION = SAMPLES / "intersection.mcap"


@pytest.fixture
def house(tmp_path: Path) -> House:
    """A copy of the package, to be broken."""
    (tmp_path / "house").mkdir()
    return House.copied_to(tmp_path / "house")


@pytest.mark.parametrize(
    ("missing", "arguments", "said"),
    [
        ("stages/track.py", ("track",), "the stage track can't be loaded: there is no module cwcli.stages.track"),
        ("stages/track.py", ("run",), "the stage track can't be loaded: there is no module cwcli.stages.track"),
        (
            "tracking/tracker.py",
            ("track",),
            "the stage track can't be loaded: there is no module cwcli.tracking.tracker",
        ),
        (
            "evaluation/estimate.py",
            ("estimate", "--metrics", "out.csv"),
            "the stage estimate can't be loaded: there is no module cwcli.evaluation.estimate",
        ),
        ("cli/commands/run.py", ("run",), "the command run can't be loaded: there is no module cwcli.cli.commands.run"),
    ],
    ids=["its own", "in a run", "one that it imports", "its evaluation", "a command's"],
)
def test_a_missing_module_is_named_and_nothing_is_written(
    cwcli: Run, house: House, tmp_path: Path, missing: str, arguments: tuple[str, ...], said: str
) -> None:
    (house.folder / "cwcli" / missing).unlink()
    command, *options = arguments
    done = cwcli(command, INTERSECTION, "-o", "out.mcap", *options, env={"PYTHONPATH": str(house.folder)})
    assert done.returncode == EXIT_USAGE, done.stderr
    assert done.stderr.decode() == f"error: {said}\n  hint:  install cwcli again\n"
    assert not list(tmp_path.glob("out*"))
    for others in (("info", INTERSECTION), ("--help",), ("predict", "--help")):
        assert cwcli(*others, env={"PYTHONPATH": str(house.folder)}).returncode == 0


@pytest.mark.parametrize(
    ("definition", "name"), [("class TrackConfig", "TrackConfig"), ("def track(", "track"), ("EXAMPLES =", "EXAMPLES")]
)
def test_a_module_without_what_a_stage_holds_says_what_is_missing(
    cwcli: Run, house: House, tmp_path: Path, definition: str, name: str
) -> None:
    path = house.folder / "cwcli" / "stages" / "track.py"
    text = path.read_text(encoding="utf-8")
    assert text.count(definition) == 1
    path.write_text(text.replace(definition, definition.replace(name, "Another")), encoding="utf-8")
    done = cwcli("track", INTERSECTION, "-o", "out.mcap", env={"PYTHONPATH": str(house.folder)})
    assert done.returncode == EXIT_USAGE
    said = f"error: the stage track can't be loaded: cwcli.stages.track has no {name}"
    assert done.stderr.decode().splitlines()[0] == said
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize("into", [("-o", "out.mcap"), ("-d", "out")])
@pytest.mark.parametrize("way", ["an option", "a pipeline file", "its table"])
def test_a_stage_that_is_not_installed_is_refused_before_the_work(
    cwcli: Run, tmp_path: Path, way: str, into: tuple[str, str]
) -> None:
    file = tmp_path / "p.toml"
    file.write_text(
        {"a pipeline file": '[run]\nstages = ["parking"]\n', "its table": "[parking]\nlimit = 2\n"}.get(way, "")
    )
    options = ("--stage", "parking") if way == "an option" else ("--config", file)
    done = cwcli("run", INTERSECTION, *into, *options)
    said = {"an option": "there is no stage parking", "a pipeline file": "there is no stage parking"}
    assert done.returncode == EXIT_USAGE
    line, hint = done.stderr.decode().splitlines()
    assert said.get(way, "unknown key [parking]") in line
    assert "known: " in hint and "estimate" in hint
    assert not list(tmp_path.glob("out*"))
    if way != "an option":
        assert cwcli("config", file).returncode == EXIT_USAGE
