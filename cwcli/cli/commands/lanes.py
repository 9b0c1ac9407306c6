"""`cwcli lanes`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from cwcli.cli.options.expand import StageOptions
from cwcli.cli.options.shared import LogArgument, MetricsOption, ReadingOptions, TalkOptions, WritingOptions
from cwcli.cli.pipeline import Job, run_job
from cwcli.pipeline.call import StageCall
from cwcli.vision.camera import DEFAULT_FIELD_OF_VIEW_RAD, Mounting
from cwcli.vision.methods import DEFAULT_METHOD, METHODS

if TYPE_CHECKING:
    from cwcli.stages.inputs.mounting import MountingChoice

EXAMPLES = (
    "cwcli lanes drive.mcap -o lanes.mcap --metrics lanes.parquet",
    "cwcli lanes drive.mcap -o lanes.mcap --render /camera/annotated",
    "cwcli lanes drive.mcap --method zhang2011 --seed 1 --camera-height 1.4",
)
MOUNTING = Mounting()


@dataclass(frozen=True)
class LanesOptions(StageOptions):
    """Options of the stage."""

    stage: ClassVar[str] = "lanes"

    method: Annotated[
        str,
        typer.Option(
            "--method",
            metavar="NAME",
            autocompletion=METHODS.complete,
            help=METHODS.help(),
        ),
    ] = DEFAULT_METHOD
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of the random numbers of a genetic search.")] = 0
    preview: Annotated[
        float, typer.Option("--preview", metavar="METRES", help="Distance of the preview point ahead of the camera.")
    ] = 33.5
    render: Annotated[
        str | None,
        typer.Option(
            "--render",
            metavar="/TOPIC",
            show_default=False,
            help="Publish the frames with the boundaries drawn on them here, as JPEG.",
        ),
    ] = None
    camera_height: Annotated[
        float | None,
        typer.Option(
            "--camera-height", metavar="METRES", show_default=f"{MOUNTING.height_m:g}", help="Above the road."
        ),
    ] = None
    camera_pitch: Annotated[
        float | None,
        typer.Option("--camera-pitch", metavar="DEGREES", show_default="0", help="Nose down positive."),
    ] = None
    camera_yaw: Annotated[
        float | None,
        typer.Option("--camera-yaw", metavar="DEGREES", show_default="0", help="To the left positive."),
    ] = None
    camera_offset: Annotated[
        float | None,
        typer.Option(
            "--camera-offset", metavar="METRES", show_default="0", help="Left of the car's centre line positive."
        ),
    ] = None
    camera_fov: Annotated[
        float | None,
        typer.Option(
            "--camera-fov",
            metavar="DEGREES",
            show_default=f"{math.degrees(DEFAULT_FIELD_OF_VIEW_RAD):.0f}",
            help="Horizontal field of view, for a log without calibration.",
        ),
    ] = None

    def mounting(self) -> MountingChoice | None:
        """What the options tell of the camera's mounting; None if nothing."""
        from cwcli.stages.inputs.mounting import MountingChoice

        choice = MountingChoice(
            height_m=self.camera_height,
            pitch_rad=None if self.camera_pitch is None else math.radians(self.camera_pitch),
            yaw_rad=None if self.camera_yaw is None else math.radians(self.camera_yaw),
            lateral_offset_m=self.camera_offset,
        )
        return choice if choice.given() else None

    def make(self) -> StageCall:
        """The stage with these options."""
        from cwcli.stages.lanes import LanesConfig, check_config

        config = LanesConfig(
            method=self.method,
            seed=self.seed,
            preview_m=self.preview,
            mounting=self.mounting(),
            field_of_view_rad=None if self.camera_fov is None else math.radians(self.camera_fov),
            render=self.render,
        )
        check_config(config)
        return StageCall(self.stage, config)


def command(
    log: LogArgument,
    options: LanesOptions,
    writing: WritingOptions,
    reading: ReadingOptions,
    talk: TalkOptions,
    metrics: MetricsOption = None,
) -> None:
    """Find the lane boundaries in camera frames.

    Needs a camera channel (JPEG, PNG, raw images or video). Adds the boundaries, the car's
    place in its lane at the preview point, and annotations that Foxglove draws on the image. The calibration is taken
    from the log where it holds one.
    """
    run_job(Job("lanes", log, {"lanes": options.make()}, reading, writing, talk, metrics=metrics))
