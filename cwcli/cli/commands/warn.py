"""`cwcli warn`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import typer

from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.shared import LogArgument, MetricsOption, ReadingOptions, TalkOptions, WritingOptions
from cwcli.cli.pipeline import Job, run_job
from cwcli.measures import MEASURES
from cwcli.pipeline.call import StageCall
from cwcli.warning.conflicts import definitions
from cwcli.warning.lane_departure import RULE as LANE_DEPARTURE
from cwcli.warning.lane_departure import LaneDepartureConfig
from cwcli.warning.rules import DEFAULT_RULE, RULES
from cwcli.warning.types import WarningConfig

EXAMPLES = (
    "cwcli warn predicted.mcap -o warned.mcap --metrics warnings.parquet",
    "cwcli warn predicted.mcap --rule song2016 --horizon 2.5 --distance 2.5",
    "cwcli warn tracked.mcap --source targets -o warned.mcap",
    "cwcli warn predicted.mcap --rules lane-departure -o warned.mcap",
)
DEFAULTS = WarningConfig()
LANE_DEFAULTS = LaneDepartureConfig()


@dataclass(frozen=True)
class WarnOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "warn"

    rule: Annotated[
        str,
        typer.Option(
            "--rule",
            metavar="NAME",
            autocompletion=RULES.complete,
            help=RULES.help(),
        ),
    ] = DEFAULT_RULE
    rules: Annotated[
        str | None,
        typer.Option(
            "--rules",
            metavar="NAME[,NAME]",
            show_default="that of --rule",
            help=f"Several rules in one pass: those of --rule, and {LANE_DEPARTURE}: the predicted path takes a front "
            "tyre over a lane boundary. A rule for which the log lacks a channel is left out if another one can run.",
        ),
    ] = None
    source: Annotated[
        Literal["v2x", "targets"],
        typer.Option("--source", help="Warn of the vehicles heard over V2X, or of the targets of `cwcli track`."),
    ] = "v2x"
    horizon: Annotated[
        float, typer.Option("--horizon", metavar="SECONDS", help="Warn of events at most this far ahead.")
    ] = DEFAULTS.horizon_s
    distance: Annotated[
        float, typer.Option("--distance", metavar="METRES", help="Centres nearer than this are a collision.")
    ] = DEFAULTS.distance_m
    probability: Annotated[float, typer.Option("--probability", metavar="P", help="Threshold of the rule cwcli.")] = (
        DEFAULTS.probability
    )
    persistence: Annotated[
        float | None,
        typer.Option(
            "--persistence",
            metavar="SECONDS",
            show_default="the rule's own",
            help="How long the condition must hold before the warning.",
        ),
    ] = DEFAULTS.persistence_s
    hold_off: Annotated[
        float,
        typer.Option("--hold-off", metavar="SECONDS", help="A condition false for this long is over."),
    ] = DEFAULTS.hold_off_s
    use: Annotated[
        Literal["received", "stamp"],
        typer.Option("--use", help="Remote states that had been received by then, or all whose stamp has passed."),
    ] = DEFAULTS.use
    max_age: Annotated[
        float, typer.Option("--max-age", metavar="SECONDS", help="Older remote states are not used.")
    ] = DEFAULTS.max_age_s
    conflict: Annotated[
        str,
        typer.Option(
            "--conflict",
            metavar="MEASURE",
            autocompletion=MEASURES.complete,
            help="What counts as a conflict when warnings are scored: a measure beyond its threshold "
            f"({definitions()}), or beyond one of yours: 'ttc < 1.5'. distance alone is that of "
            "--distance.",
        ),
    ] = DEFAULTS.conflict
    max_lead: Annotated[
        float,
        typer.Option("--max-lead", metavar="SECONDS", help="A warning earlier than this is not about the conflict."),
    ] = DEFAULTS.max_lead_s

    line_crossing: Annotated[
        float,
        typer.Option(
            "--line-crossing",
            metavar="SECONDS",
            help="lane-departure: warn when the time to line crossing falls to this.",
        ),
    ] = LANE_DEFAULTS.warn_s
    lane_speed: Annotated[
        float,
        typer.Option("--lane-speed", metavar="MPS", help="lane-departure: no warning is raised below this speed."),
    ] = LANE_DEFAULTS.min_speed_mps

    def make(self) -> StageCall:
        """The stage with these options."""
        from cwcli.stages.warn import WarnConfig, check_config

        rule = WarningConfig(
            rule=self.rule,
            horizon_s=self.horizon,
            distance_m=self.distance,
            probability=self.probability,
            persistence_s=self.persistence,
            hold_off_s=self.hold_off,
            use=self.use,
            max_age_s=self.max_age,
            conflict=self.conflict,
            max_lead_s=self.max_lead,
        )

        names = () if self.rules is None else tuple(name.strip() for name in self.rules.split(","))
        lanes = LaneDepartureConfig(
            warn_s=self.line_crossing,
            release_s=max(LANE_DEFAULTS.release_s, self.line_crossing),
            min_speed_mps=self.lane_speed,
        )
        config = WarnConfig(rule=rule, rules=names, lane_departure=lanes, source=self.source)
        check_config(config)
        return StageCall(self.stage, config)


def command(
    log: LogArgument,
    options: WarnOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
) -> None:
    """Warn the ego vehicle of collisions with the others, and of leaving its lane.

    Needs the channels of `cwcli predict`, and for `--source targets` those of `cwcli track` on the same log; the rule
    lane-departure needs those of `cwcli lanes` and `cwcli predict --from observer`. One conflict is one warning:
    raised, held, cleared. Where the log holds what really happened, collision warnings are scored as true, false, late
    or missed, with their lead times.
    """
    run_job(Job("warn", log, {"warn": options.make()}, reading, writing, talk, metrics=metrics))
