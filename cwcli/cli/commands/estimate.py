"""`cwcli estimate`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import typer

from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.shared import (
    LogArgument,
    MetricsOption,
    ReadingOptions,
    SensorOptions,
    TalkOptions,
    WritingOptions,
)
from cwcli.cli.pipeline import Job, run_job
from cwcli.errors import UsageError
from cwcli.pipeline.call import StageCall

if TYPE_CHECKING:
    from cwcli.estimation.config import LatencyOption

EXAMPLES = (
    "cwcli estimate drive.mcap -o estimated.mcap --metrics estimate.parquet",
    "cwcli estimate drive.mcap --latency /gps/vel=300 --causal -o estimated.mcap",
)
MS_PER_S = 1000.0
MAX_LATENCY_S = 3600.0


@dataclass(frozen=True)
class EstimateOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "estimate"

    model: Annotated[
        Literal["cwcli", "song2016"],
        typer.Option(
            "--model", help="cwcli: eight states, each sensor at its own time; song2016: the paper's six-state filter."
        ),
    ] = "cwcli"
    causal: Annotated[
        bool, typer.Option("--causal", help="The filter alone: no estimate uses what was measured later.")
    ] = False
    latency: Annotated[
        list[str],
        typer.Option(
            "--latency",
            metavar="auto|none|NAME=MS",
            show_default="auto",
            help="Find each source's latency from the log, trust the stamps, or give that of a topic in milliseconds "
            "(positive is late; the others are found). Repeatable.",
        ),
    ] = field(default_factory=list)
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", help="Rate of the ego's states.")] = 20.0
    gate: Annotated[
        float,
        typer.Option("--gate", metavar="P", help="Probability that the gate keeps a good measurement; 1 is off."),
    ] = 0.999
    truth_origin: Annotated[
        str | None,
        typer.Option(
            "--truth-origin",
            metavar="LAT,LON,ALT",
            show_default=False,
            help="Where the origin of a Cartesian truth channel lies, in degrees and metres.",
        ),
    ] = None

    def make(self, sensors: SensorOptions) -> StageCall:
        """The stage with these options."""
        from cwcli.estimation.config import EstimatorConfig
        from cwcli.stages.estimate import EstimateConfig
        from cwcli.stages.inputs.sources import SourceConfig

        if not 0 < self.rate <= 10_000:
            raise UsageError(f"--rate {self.rate:g} must be above 0 and at most 10000 Hz")
        if not 0 < self.gate <= 1:
            raise UsageError(f"--gate {self.gate:g} must be a probability above 0")
        estimator = EstimatorConfig(
            model=self.model,
            causal=self.causal,
            latency=parse_latency(self.latency),
            gate_probability=self.gate,
        )
        origin = parse_origin(self.truth_origin)

        sources = SourceConfig(clock=sensors.clock, ego_station=sensors.ego_station)
        config = EstimateConfig(sources=sources, estimator=estimator, rate_hz=self.rate, truth_origin=origin)
        return StageCall(self.stage, config)


def parse_latency(entries: list[str]) -> LatencyOption:
    """`auto`, `none`, or source -> seconds from `NAME=MS` entries.

    Raises:
        UsageError: An entry is malformed, a source comes twice, or entries contradict each other.
    """
    if not entries or entries == ["auto"]:
        return "auto"
    if entries == ["none"]:
        return "none"
    found: dict[str, float] = {}
    for entry in entries:
        name, _, text = entry.rpartition("=")
        try:
            latency_s = float(text.removesuffix("ms")) / MS_PER_S
        except ValueError:
            latency_s = math.nan
        if not name or not abs(latency_s) <= MAX_LATENCY_S:
            raise UsageError(
                f"--latency {entry!r} is not auto, none or NAME=MS", hint="for example --latency /gps/fix=80"
            )
        if name in found:
            raise UsageError(f"--latency names {name} twice")
        found[name] = latency_s
    return found


def parse_origin(text: str | None) -> tuple[float, float, float] | None:
    """`LAT,LON,ALT` in degrees and metres.

    Raises:
        UsageError: It is not three numbers in range.
    """
    if text is None:
        return None
    try:
        latitude_deg, longitude_deg, altitude_m = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"--truth-origin {text!r} is not LAT,LON,ALT") from None
    if not (abs(latitude_deg) <= 90 and abs(longitude_deg) <= 180 and math.isfinite(altitude_m)):
        raise UsageError(f"--truth-origin {text!r} is not on the earth")
    return latitude_deg, longitude_deg, altitude_m


def command(
    log: LogArgument,
    options: EstimateOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    sensors: SensorOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
) -> None:
    """Estimate the states of the ego and the remote vehicles.

    Needs the ego's position; uses its velocity, speed, heading and IMU, V2X messages and a truth channel where the log
    has them. Each source's latency and the IMU's biases are found from the log itself and reported.
    """
    run_job(Job("estimate", log, {"estimate": options.make(sensors)}, reading, writing, talk, metrics=metrics))
