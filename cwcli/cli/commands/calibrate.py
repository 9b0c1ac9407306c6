"""`cwcli calibrate`."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.configfile import TalkOptions
from cwcli.cli.options.shared import ForceOption, ReadingOptions, SensorOptions
from cwcli.cli.progress import Progress
from cwcli.cli.report import print_written_files
from cwcli.cli.tables import Cell, format_table
from cwcli.cli.text import finite_or_none, format_count
from cwcli.errors import EXIT_DONE, CwcliError, UsageError
from cwcli.url import display_name_of_url
from cwcli.work_share import part_of_work, report_work_share_to

if TYPE_CHECKING:
    from cwcli.estimation.calibration import Calibration, Constant
    from cwcli.estimation.pooling import DriveEvidence

EXAMPLES = (
    "cwcli calibrate monday.mcap tuesday.mcap wednesday.mcap -o car.toml",
    "cwcli estimate drive.mcap --calibration car.toml -o estimated.mcap",
)
"""Command lines at the end of the command's `--help`."""
CALIBRATION_TABLE_HEADINGS = (
    "source",
    "quantity",
    "constant",
    "value",
    "95 % bound, +-",
    "logs used",
    "chi2/dof between logs",
    "agreement of the logs",
)
"""Headings of the table of constants."""
FORMAT_BY_DRIVING_EVIDENCE = {
    "distance_km": "{:.3g} km",
    "accel_rms_mps2": "acceleration {:.3g} m/s^2 RMS",
    "yaw_rate_rms_radps": "yaw rate {:.3g} rad/s RMS",
}
"""Key of a calibration's evidence -> how the output says it."""
SHOWN_CONSTANTS = ("latency_s", "bias", "scale", "lever_arm_m", "ahead_m", "noise_sigma", "noise_scale",
        "stamp_sigma_s", "slow_sigma", "slow_time_s", "nose_up_rad", "left_up_rad", "pitch_rad")  # fmt: skip
"""Names of the constants that the table shows; the file holds some more."""
MAX_DIFFERENCE_OF_SYNCHRONISED_CLOCKS_S = 0.01
"""Largest difference of synchronised clocks in one car, s; chosen: NTP over a vehicle network keeps milliseconds."""
MAX_LOGS_NAMED_IN_NOTE = 4
"""Largest number of logs that a note names; chosen by hand."""
CONSTANTS_WITH_NOTES = ("latency_s", "bias", "scale", "lever_arm_m", "ahead_m", "stamp_sigma_s", "nose_up_rad",
         "left_up_rad", "pitch_rad")  # fmt: skip
"""Names of the constants on which notes are printed."""


def command(
    logs: Annotated[list[str], typer.Argument(metavar="LOG", help="MCAP files of drives of one car.")],
    reading: ReadingOptions,
    sensors: SensorOptions,
    talk: TalkOptions,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="FILE", help="Write the calibration here (.toml).")
    ] = None,
    force: ForceOption = False,
) -> int:
    """Find the constants of a car's sensors from many drives: latencies, biases, mounting, noise.

    Each log is estimated by itself. The estimates of each constant are pooled, weighted by their uncertainties; where
    the logs disagree by more than that, the interval is wider and a note says so. `--calibration
    car.toml` of estimate, lanes, observe and run uses the file. A log that fails is reported and left out; the exit
    code is then that of its error.
    """
    from cwcli.estimation.calibration import format_calibration_toml
    from cwcli.estimation.pooling import calibrate_from_drives
    from cwcli.output import refuse_unwritable_targets, write_file

    if output is not None and not output.endswith(".toml"):
        raise UsageError(f"-o {output} must end in .toml")
    if reading.as_one:
        raise UsageError("--as-one: this takes many logs", hint="a folder with a metadata.yaml is one of them")
    if len(set(logs)) < len(logs):
        raise UsageError("a log is named twice: it would count twice")
    refuse_unwritable_targets([output] if output is not None else [], force=force, inputs=logs)
    console = Console(quiet=talk.quiet)
    drives: list[DriveEvidence] = []
    worst: CwcliError | None = None
    with Progress(quiet=talk.quiet) as progress, report_work_share_to(progress.show_share):
        for k, log in enumerate(logs):
            progress.begin_step(f"estimating {log}")
            try:
                with part_of_work(k / len(logs), (k + 1) / len(logs)):
                    drives.append(_estimate_drive(log, reading, sensors))
            except CwcliError as error:
                if len(logs) == 1:
                    raise
                worst = error if worst is None or error.exit_code > worst.exit_code else worst
                console.print_note(f"{error.where or display_name_of_url(log)}: {error.what}; left out")
    if not drives:
        assert worst is not None
        raise worst
    found = calibrate_from_drives(drives, output or "")
    if output is not None:
        write_file(output, format_calibration_toml(found).encode(), force=force)
    if talk.json:
        console.print_document("calibrate", _calibration_document(found))
    else:
        _print_calibration(console, found)
        print_written_files(console, [output] if output is not None else [])
    return EXIT_DONE if worst is None else worst.exit_code


def _estimate_drive(name: str, reading: ReadingOptions, sensors: SensorOptions) -> DriveEvidence:
    """One log, estimated from the whole of it.

    Raises:
        CwcliError: As reading and estimating do.
    """
    from cwcli.array_memory import bound_array_memory_and_get_old_handler
    from cwcli.cli.options.stage import make_stage_options_class, stage_call_from_options
    from cwcli.estimation.pooling import DriveEvidence
    from cwcli.pipeline.call import config_with_selection
    from cwcli.pipeline.camera_pitch import estimate_camera_pitch
    from cwcli.pipeline.execute import RunOutcome, raise_on_data_faults_or_contradictions
    from cwcli.pipeline.selection import resolve_selection

    bound_array_memory_and_get_old_handler()
    call = stage_call_from_options(make_stage_options_class("estimate")(), sensors)
    with reading.open_log(name) as log:
        selection = resolve_selection(log, reading.topics_and_mappings, reading.start, reading.end)
        result = call.stage.stage_function(log, config_with_selection(call.config, selection))
        if reading.strict:
            raise_on_data_faults_or_contradictions(
                RunOutcome(log.name, results=[result], faults=log.faults.counts_by_reason()), log.start_ns
            )
        pitch = estimate_camera_pitch(log)
    cameras = {} if pitch is None else {pitch.topic: (pitch.pitch_rad, pitch.sigma_rad)}
    return DriveEvidence(Path(log.name).name, result.evaluation_inputs.ego, cameras)


def _constant_table_rows(found: Calibration) -> list[tuple[Cell, ...]]:
    from cwcli.estimation.calibration import ConstantStatus

    rows: list[tuple[Cell, ...]] = []
    for source, quantities in found.sensors.items():
        for quantity, constants in quantities.items():
            for name, constant in constants.items():
                if name not in SHOWN_CONSTANTS:
                    continue
                is_reference = constant.status is ConstantStatus.REFERENCE
                status = constant.status.value
                if constant.status is ConstantStatus.DISAGREE:
                    status += f" (I^2 {100 * constant.i_squared_between_drives:.0f} %)"
                numbers = (constant.value, 1.96 * constant.sigma_in_another_drive)
                rows.append(
                    (source, quantity.replace("_", " "), name, *((math.nan, math.nan) if is_reference else numbers),
                     constant.n_logs, constant.chi_square, status)
                )  # fmt: skip
    return rows


def _print_calibration(console: Console, found: Calibration) -> None:
    """Print the table of constants, and notes on those that the logs disagree on."""
    console.print_heading(f"Calibration from {format_count(len(found.logs), 'log')}, {found.minutes:.1f} minutes")
    driven = [
        text.format(found.evidence[key]) for key, text in FORMAT_BY_DRIVING_EVIDENCE.items() if key in found.evidence
    ]
    if driven:
        console.print_summary(f"driven: {', '.join(driven)}")
    console.print_summary(format_table(CALIBRATION_TABLE_HEADINGS, _constant_table_rows(found)))
    for source, quantities in found.sensors.items():
        for quantity, constants in quantities.items():
            for name, constant in constants.items():
                if name in CONSTANTS_WITH_NOTES:
                    for note in _notes_on_constant(constant, name):
                        console.print_note(f"{source}: {name} of {quantity.replace('_', ' ')}: {note}")
    if len(found.logs) == 1:
        console.print_note("one log: the spread between drives is unknown")


def _notes_on_constant(constant: Constant, name: str) -> list[str]:
    """Notes on a constant: that the logs disagree on it, or that a latency is negative."""
    from cwcli.estimation.calibration import ConstantStatus

    notes = []
    if constant.status is ConstantStatus.DISAGREE:
        values = [f"{log} {value:.3g} +- {sigma:.2g}" for log, value, sigma in constant.of_logs]
        more = f", and {len(values) - MAX_LOGS_NAMED_IN_NOTE} more" if len(values) > MAX_LOGS_NAMED_IN_NOTE else ""
        used = "" if name != "latency_s" or constant.is_usable_in_any_drive else "; it will not be used"
        notes.append(
            f"the logs disagree ({', '.join(values[:MAX_LOGS_NAMED_IN_NOTE])}{more}), one drive differs from the next "
            f"by {constant.spread:.3g}{used}"
        )
    if name == "latency_s" and constant.value < -max(MAX_DIFFERENCE_OF_SYNCHRONISED_CLOCKS_S, 3.0 * constant.sigma):
        notes.append(
            "below zero: nothing is stamped before it is measured, so the reference is late by at least as much, "
            "or the clocks differ"
        )
    return notes


def _calibration_document(found: Calibration) -> dict[str, Any]:
    """Make the content of `--json`: that of the file, with null for numbers that are not finite."""
    return {key: _replace_non_finite(value) for key, value in asdict(found).items()}


def _replace_non_finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _replace_non_finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_non_finite(each) for each in value]
    return finite_or_none(value) if isinstance(value, float) else value
