"""Stage `observe`: lane boundaries and the ego's speed in, lateral speed and yaw rate out (zhang2011, section 3)."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated

import numpy as np

from cwcli.channels.binding import Bindings, bind_roles
from cwcli.channels.lanes import FIELDS_FOR_OBSERVER
from cwcli.channels.lateral_state import LATERAL_TRUTH_FIELDS, ObservedDrive, make_observer_channel
from cwcli.channels.published import EGO_STATE, LANES
from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.observer import DEFAULT_OBSERVER_METHOD
from cwcli.dynamics.observer import observe_lateral_motion as observe_lateral
from cwcli.dynamics.samples import FrameStatus, LateralTrack
from cwcli.dynamics.single_track import critical_speed_mps
from cwcli.dynamics.table import observer_table
from cwcli.dynamics.vehicle import DEFAULT_VEHICLE, Vehicle, load_vehicle
from cwcli.errors import DataError, MissingSignalError
from cwcli.estimation.calibration import Calibration, run_record_entry_of_calibration_file
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.records import vehicle_to_record_entry
from cwcli.pipeline.result import Cell, StageResult, StageSummary, SummaryTable
from cwcli.pipeline.run_record import build_run_record
from cwcli.pipeline.states import StatesSelection, bind_state_channels
from cwcli.signals.columns import Columns, median_of_finite
from cwcli.signals.role import Role
from cwcli.stages.inputs.calibrated import apply_calibration_to_sources
from cwcli.stages.inputs.observer import ObserverInputs, choose_observer_inputs, lane_samples_at_preview
from cwcli.stages.inputs.sources import read_sensor_signals
from cwcli.stages.summaries import largest_finite_magnitude

READ_FIELDS_BY_ROLE: dict[str, tuple[str, ...]] = {
    LANES.role: FIELDS_FOR_OBSERVER,
    Role.LATERAL_TRUTH: LATERAL_TRUTH_FIELDS,
}
"""Role -> the leaf fields that are read of its channel."""
EXAMPLES = (
    "cwcli observe lanes.mcap -o observed.mcap --vehicle vehicle.toml",
    "cwcli observe lanes.mcap --method zhang2011 --load full",
    "cwcli lanes drive.mcap -o - | cwcli observe - -o observed.mcap",
)
"""Command lines that the help of `cwcli observe` shows."""
OBSERVER_SENSOR_ROLES = (Role.EGO_SPEED, Role.EGO_VELOCITY, Role.IMU, Role.EGO_STEER)
"""Roles of the ego's own sensors that the observer may use."""


@dataclass(frozen=True)
class ObserveConfig(StatesSelection):
    """Settings of the stage.

    Attributes:
        vehicle: The car, or its file's name, which is read at once; None: the shipped example, which is noted.
        load: Of its file.
        observer: Method and its options; the preview distance is that of the lanes.
        use_gyro: Fuse a measured yaw rate, if the log has one.
        use_steer: Use a measured steering angle, if the log has one.
        calibration: Constants of the sensors from other drives, or None.
    """

    vehicle: Annotated[
        Vehicle | str | None,
        Option(
            "--vehicle",
            "TOML file of the car, or the name of a shipped one.",
            metavar="FILE",
            default=f"the shipped example {DEFAULT_VEHICLE}",
            kind=str | None,
        ),
    ] = None
    load: Annotated[
        str | None, Option("--load", "A load of the car's file.", metavar="NAME", default="the file's own")
    ] = None
    observer: ObserverConfig = field(default_factory=ObserverConfig)
    use_gyro: Annotated[bool, Option("--gyro/--no-gyro", "Fuse the measured yaw rate, if there is one (cwcli).")] = True
    use_steer: Annotated[
        bool, Option("--steering/--no-steering", "Use the measured steering angle, if there is one.")
    ] = True
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        """Read the car's file: who runs the stage may be another machine.

        Raises:
            UsageError: There is no such file or load.
        """
        if isinstance(self.vehicle, str) or self.load is not None:
            assert not isinstance(self.vehicle, Vehicle), "a load belongs to a car's file"
            object.__setattr__(self, "vehicle", load_vehicle(self.vehicle or DEFAULT_VEHICLE, load=self.load))
            object.__setattr__(self, "load", None)

    @property
    def vehicle_named_by_user(self) -> Vehicle | None:
        """The car, if one was named."""
        assert not isinstance(self.vehicle, str), "it is read at once"
        return self.vehicle


@dataclass(frozen=True)
class ObserverEvidence:
    """Values that the evaluation of the stage needs.

    Attributes:
        track: The observed motion.
        truth: Columns of the truth's channel, None without one.
    """

    track: LateralTrack
    truth: Columns | None


def observe(log: Log, config: ObserveConfig) -> StageResult:
    """Observe the ego's lateral speed and yaw rate from its lane.

    Needs the channel of `cwcli lanes` and the ego's speed; uses a gyroscope and a measured steering angle where the log
    has them. Where the log holds the true motion, errors are shown.

    Raises:
        MissingSignalError: The log has no lanes, or nothing tells the ego's speed.
        UsageError: An unknown method, or a setting out of its range.
        DataError: The lanes are of another version, or the speed covers none of the frames.
    """
    own = bind_state_channels(
        log.channels,
        config,
        required=(LANES.role,),
        optional=(EGO_STATE.role, Role.LATERAL_TRUTH),
        where=log.name,
        command="observe",
    )
    sources = read_sensor_signals(
        log,
        config,
        command="observe",
        optional=OBSERVER_SENSOR_ROLES,
        also=own,
        fields=READ_FIELDS_BY_ROLE,
    )
    with_shape = config.observer.method == DEFAULT_OBSERVER_METHOD
    lanes = lane_samples_at_preview(sources.columns[LANES.role], where=log.name, with_shape=with_shape)
    ego_state = sources.columns.get(EGO_STATE.role)
    sources = apply_calibration_to_sources(sources, config.calibration)
    inputs = choose_observer_inputs(sources, ego_state, use_gyro=config.use_gyro, use_steer=config.use_steer)
    if inputs.speed is None:
        raise _no_speed_error(log, config)
    vehicle = config.vehicle_named_by_user or load_vehicle()
    track = observe_lateral(
        lanes.samples,
        inputs.speed,
        vehicle,
        replace(config.observer, preview_m=lanes.preview_m),
        yaw_rate=inputs.yaw_rate,
        steer=inputs.steer,
    )
    if (track.status == FrameStatus.NO_SPEED).all():
        raise DataError(
            "the speed covers none of the frames",
            where=f"{log.name}: {inputs.speed_source}",
            hint="compare the two channels' times; their clocks may differ",
        )
    table = observer_table(track)
    summary = StageSummary(
        title=f"observe ({config.observer.method})",
        sections=(_observed_frames_table(track, inputs),),
        inputs=(lanes.count, *inputs.counts),
        notes=_build_notes(own, inputs, track, vehicle, config),
    )
    known = {**vehicle_to_record_entry(vehicle), **run_record_entry_of_calibration_file(config.calibration)}
    record = build_run_record("observe", log, replace(config, calibration=None), summary, **known)
    return StageResult(
        "observe",
        (make_observer_channel(ObservedDrive(lanes.log_time_ns, track)),),
        {table.name: table},
        summary,
        record,
        evaluation_inputs=ObserverEvidence(track, sources.columns.get(Role.LATERAL_TRUTH)),
    )


def _no_speed_error(log: Log, config: ObserveConfig) -> MissingSignalError:
    """Return the error for a missing speed: no channel, several of them, or none with a usable message."""
    try:
        bind_roles(log.channels, config.topics, required=(Role.EGO_SPEED,), where=log.name, command="observe")
    except MissingSignalError as error:
        return error
    return MissingSignalError(
        "no channel holds the ego speed (needed by `cwcli observe`)",
        where=log.name,
        hint="see which messages were rejected with `cwcli estimate`, or choose another channel with --topic ego_speed",
    )


def _build_notes(
    bound: Bindings, inputs: ObserverInputs, track: LateralTrack, vehicle: Vehicle, config: ObserveConfig
) -> tuple[str, ...]:
    """Return the notes on the inputs, the car and the frames."""
    notes = [*bound.notes, *inputs.notes, *track.notes]
    if config.vehicle is None:
        notes.append(f"no vehicle file was given: the bundled car {vehicle.name} is assumed (--vehicle FILE)")
    critical_mps = critical_speed_mps(vehicle)
    if np.nanmax(track.speed_mps) > critical_mps:
        notes.append(f"{vehicle.name} oversteers and is unstable above {critical_mps:.1f} m/s")
    if not np.isfinite(track.state[:, 0]).any():
        notes.append("no frame has a state")
    return tuple(notes)


def _observed_frames_table(track: LateralTrack, inputs: ObserverInputs) -> SummaryTable:
    """Return the table of the observed frames and their states."""
    n = len(track)
    rows: list[tuple[Cell, ...]] = [("frames", n)]
    rows += [(f"frames {name.replace('_', ' ')}", count) for name, count in track.counts.items() if count]
    rows += [
        ("speed from", inputs.speed_source),
        ("yaw rate from", inputs.yaw_rate_source or "-"),
        ("steering angle from", inputs.steer_source or "the lanes"),
        ("largest yaw rate (deg/s)", largest_finite_magnitude(np.degrees(track.state[:, 1]))),
        ("largest lateral speed (m/s)", largest_finite_magnitude(track.state[:, 0])),
        (
            "sigma of the yaw rate, median (deg/s)",
            median_of_finite(np.degrees(np.sqrt(np.abs(track.covariance[:, 1, 1])))),
        ),
        (
            "sigma of the lateral speed, median (m/s)",
            median_of_finite(np.sqrt(np.abs(track.covariance[:, 0, 0]))),
        ),
    ]
    known = np.flatnonzero(np.isfinite(track.mass_sigma_kg))
    if len(known):
        last = known[-1]
        rows.append(("mass at the end (kg)", float(track.mass_kg[last])))
        rows.append(("its sigma (kg)", float(track.mass_sigma_kg[last])))
    return SummaryTable("observer", "Lateral motion of the ego in its lane", ("quantity", "value"), tuple(rows))
