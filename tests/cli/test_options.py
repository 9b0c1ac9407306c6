"""Options: one meaning, and flag over environment over configuration file over default."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest
import typer
import typer.main

from cwcli.cli.app import PlainCommand
from cwcli.cli.info_texts import format_utc_time
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.expand import expand_dataclass_parameters
from cwcli.cli.options.lazy_typer import Option, use_typer_declarations
from cwcli.cli.options.shared import LogArgument, ReadingOptions, SensorOptions
from cwcli.cli.options.stage import StageOptions
from cwcli.errors import UsageError
from cwcli.estimation.config import parse_latency_option
from cwcli.pipeline.selection import parse_time_ns
from cwcli.signals.geodesy import parse_truth_origin


@dataclass(frozen=True)
class EstimateLikeOptions(StageOptions):
    stage: ClassVar[str] = "estimate"
    model: Annotated[Literal["cwcli", "song2016"], Option("--model")] = "cwcli"
    causal: Annotated[bool, Option("--causal/--no-causal")] = False
    rate_hz: Annotated[float, Option("--rate")] = 20.0


def parse(command: str, *arguments: str) -> Any:
    """The options that a command made of shared and stage options sees."""
    seen: list[Any] = []

    def body(
        log: LogArgument,
        reading: ReadingOptions,
        stage: EstimateLikeOptions,
        talk: TalkOptions,
        sensors: SensorOptions,
    ) -> None:
        seen.extend((log, reading, stage, talk, sensors))

    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(command, cls=PlainCommand)(use_typer_declarations(expand_dataclass_parameters(body, command)))
    built = typer.main.get_command(app)
    with built.make_context(command, list(arguments)) as context:
        built.invoke(context)
    return seen


@pytest.fixture
def config_file(tmp_path: Path) -> Callable[[str], str]:
    def write(text: str) -> str:
        path = tmp_path / "cwcli.toml"
        path.write_text(text)
        return str(path)

    return write


def test_defaults() -> None:
    log, reading, stage, talk, sensors = parse("estimate", "drive.mcap")
    assert log == ["drive.mcap"]
    assert reading == ReadingOptions()
    assert stage == EstimateLikeOptions()
    assert talk == TalkOptions()
    assert sensors == SensorOptions()


def test_topic_is_repeatable() -> None:
    reading = parse("estimate", "-", "--topic", "imu=/a", "--topic", "camera=/b")[1]
    assert reading.topic == ["imu=/a", "camera=/b"]


def test_precedence(config_file: Callable[[str], str], monkeypatch: pytest.MonkeyPatch) -> None:
    path = config_file('clock = "log"\n[estimate]\nmodel = "song2016"\nrate-hz = 50\n')
    arguments = ["drive.mcap", "--config", path]
    assert parse("estimate", *arguments)[2] == EstimateLikeOptions("song2016", False, 50.0)
    assert parse("estimate", *arguments)[4].clock == "log"
    monkeypatch.setenv("CWCLI_ESTIMATE_MODEL", "cwcli")
    monkeypatch.setenv("CWCLI_CLOCK", "stamp")
    assert parse("estimate", *arguments)[2].model == "cwcli"
    assert parse("estimate", *arguments)[4].clock == "stamp"
    assert parse("estimate", *arguments, "--model", "song2016")[2].model == "song2016"
    assert parse("estimate", *arguments, "--clock", "log")[4].clock == "log"


def test_environment_names_the_configuration_file(
    config_file: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CWCLI_CONFIG", config_file("strict = true\n"))
    assert parse("estimate", "drive.mcap")[1].strict is True


def test_run_prefixes_the_options_of_a_stage(
    config_file: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert parse("run", "drive.mcap", "--estimate-model", "song2016")[2].model == "song2016"
    assert parse("run", "drive.mcap", "--estimate-causal")[2].causal is True
    assert parse("run", "drive.mcap", "--no-estimate-causal")[2].causal is False
    path = config_file("[estimate]\ncausal = true\n")
    assert parse("run", "drive.mcap", "--config", path)[2].causal is True
    monkeypatch.setenv("CWCLI_ESTIMATE_RATE_HZ", "10")
    assert parse("run", "drive.mcap")[2].rate_hz == 10.0


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("stricct = true\n", "unknown key stricct"),
        ("[estimat]\n", "unknown key [estimat]"),
        ("[estimate]\nmodell = 'x'\n", "unknown key estimate.modell"),
        ("strict = 'yes'\n", "strict must be true or false"),
        ("topic = 'imu=/a'\n", "topic must be a list"),
        ("clock = ['log']\n", "clock must not be a list"),
        ("clock = true\n", "clock must not be true or false"),
        ("strict = \n", "not TOML"),
        ("topic = " + "[" * 5000 + "]" * 5000 + "\n", "not TOML"),
    ],
)
def test_wrong_configuration_is_a_usage_error(config_file: Callable[[str], str], text: str, what: str) -> None:
    path = config_file(text)
    with pytest.raises(UsageError) as caught:
        parse("estimate", "drive.mcap", "--config", path)
    assert what in caught.value.what
    assert caught.value.where == path


def test_tables_of_other_commands_are_left_alone(config_file: Callable[[str], str]) -> None:
    path = config_file("[warn]\nrule = 'ttc'\n")
    assert parse("estimate", "drive.mcap", "--config", path)[2] == EstimateLikeOptions()


def test_configuration_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="No such file"):
        parse("estimate", "drive.mcap", "--config", str(tmp_path / "none.toml"))


@pytest.mark.parametrize("rate", ["nan", "inf", "fast", ""])
def test_number_options_take_finite_numbers(rate: str) -> None:
    with pytest.raises(typer.BadParameter):
        parse("estimate", "drive.mcap", "--rate", rate)


START_NS = 1_700_000_000_123_456_789


@pytest.mark.parametrize(
    ("text", "expected_ns"),
    [
        ("0", START_NS),
        ("12.5", START_NS + 12_500_000_000),
        ("0.000000001", START_NS + 1),
        ("2023-11-14T22:13:20Z", 1_700_000_000_000_000_000),
        ("2023-11-14T22:13:20.25", 1_700_000_000_250_000_000),
        ("2023-11-14T23:13:20+01:00", 1_700_000_000_000_000_000),
    ],
    ids=["zero", "seconds", "nanosecond", "utc", "naive", "offset"],
)
def test_time_ns(text: str, expected_ns: int) -> None:
    assert parse_time_ns(text, START_NS, "--start") == expected_ns


@pytest.mark.parametrize("text", ["-1", "nan", "inf", "yesterday", "", "1e30"])
def test_time_ns_refuses(text: str) -> None:
    with pytest.raises(UsageError, match="--end"):
        parse_time_ns(text, START_NS, "--end")


def test_utc() -> None:
    assert format_utc_time(START_NS) == "2023-11-14 22:13:20.123 UTC"
    assert format_utc_time(2**63 - 1) == "2262-04-11 23:47:16.854 UTC"
    assert format_utc_time(2**64 * 1000) == f"{2**64 * 1000} ns"


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ([], "auto"),
        (["auto"], "auto"),
        (["none"], "none"),
        (["/gps/fix=80"], {"/gps/fix": 0.08}),
        (["/gps/vel:velocity=300ms", "/a=b=-50"], {"/gps/vel:velocity": 0.3, "/a=b": -0.05}),
    ],
)
def test_parse_latency(entries: list[str], expected: object) -> None:
    assert parse_latency_option(entries) == expected


@pytest.mark.parametrize(
    "entries", [["fast"], ["/a="], ["=5"], ["/a=inf"], ["/a=1", "/a=2"], ["auto", "/a=1"], ["none", "auto"]]
)
def test_parse_latency_refuses(entries: list[str]) -> None:
    with pytest.raises(UsageError, match="--latency"):
        parse_latency_option(entries)


def test_parse_origin() -> None:
    assert parse_truth_origin("48.98,8.39,116.4") == (48.98, 8.39, 116.4)


@pytest.mark.parametrize("text", ["48.98", "a,b,c", "91,0,0", "0,181,0", "0,0,nan", "nan,0,0"])
def test_parse_origin_refuses(text: str) -> None:
    with pytest.raises(UsageError, match="--truth-origin"):
        parse_truth_origin(text)
