"""Imports files: reads them, finds what they mean, and writes the log."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import field, replace

from cwcli.errors import MissingSignalError
from cwcli.importing.answers import check_answers
from cwcli.importing.channels import (
    FIX_TOPIC,
    HEADING_TOPIC,
    IMU_TOPIC,
    POSE_TOPIC,
    SPEED_TOPIC,
    STEERING_TOPIC,
    VELOCITY_TOPIC,
    channels_of_table,
)
from cwcli.importing.inertial import acceleration_table_by_turn_rate_table, find_accelerations_and_turn_rates
from cwcli.importing.load import load_table
from cwcli.importing.mapping import format_mapping
from cwcli.importing.meaning import Meaning
from cwcli.importing.motion import TrackSpans
from cwcli.importing.names import COLUMN_WORDS_BY_QUANTITY
from cwcli.importing.places import find_positions_and_track, keep_rows_of_one_vehicle
from cwcli.importing.poses import rotate_poses_into_car_axes
from cwcli.importing.readers import find_kind_name, load_kind
from cwcli.importing.readers.base import FileHead, Recording
from cwcli.importing.readers.trajectory import is_one_number_per_line
from cwcli.importing.speeds import find_headings, find_speed_and_unit, find_velocity, find_yaw_rate
from cwcli.importing.stamps import interpret_times_of_table, require_rows_of_one_recording
from cwcli.importing.tables import AmbiguousError, Answers, Guess, Question, SourceTable
from cwcli.importing.units import FACTOR_BY_KIND_AND_UNIT
from cwcli.input import InputFile
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import OutputChannel

MIXED_SEPARATORS_PATTERN = re.compile(r"[\w ]+([,;\t|])[\w ]+(\1[\w ]+)*")
"""The name of a column that another separator divides: `lat,lon`."""
MAX_LOOKED_AT_CHARACTERS = 200
"""Number of characters of a name that are compared with it. Chosen by hand."""
METADATA_NAME = "cwcli.import"
"""Name of the metadata record that says how the files were read."""

REQUIRED_QUANTITIES_BY_TOPIC = {
    FIX_TOPIC: ("latitude", "longitude"),
    POSE_TOPIC: ("x", "y"),
    VELOCITY_TOPIC: ("course",),
    SPEED_TOPIC: ("speed",),
    HEADING_TOPIC: ("heading",),
    IMU_TOPIC: ("accel_x", "gyro_x"),
    STEERING_TOPIC: ("steering",),
}
"""Topic -> quantities without which a table has no such channel."""


@dataclass(frozen=True)
class ImportPlan:
    """What an import makes.

    Attributes:
        kinds: File -> kind.
        tables: Name of each table and its guesses.
        channels: Table and channel, in the order of the files.
        recordings: What its reader makes channels of itself.
        notes: Table -> what the user should know.
        unused: Table -> columns that are no quantity.
        answers: What the user decided.
    """

    kinds: Mapping[str, str]
    tables: tuple[tuple[str, tuple[Guess, ...]], ...]
    channels: tuple[tuple[str, OutputChannel], ...]
    recordings: tuple[Recording, ...] = ()
    notes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    unused: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    answers: Answers = field(default_factory=Answers)

    @property
    def topics(self) -> list[tuple[str, str, int, str]]:
        """Topic, schema, number of messages and table of each channel."""
        topic_rows = [(channel.topic, channel.schema_name, len(channel), table) for table, channel in self.channels]
        return topic_rows + [(*topic, each.name) for each in self.recordings for topic in each.topics]

    def mapping_text(self) -> str:
        """Return the mapping file."""
        return format_mapping(self.answers, self.tables)


def plan_import(files: Sequence[str], answers: Answers) -> ImportPlan:
    """Read files and find what they mean.

    Raises:
        InputError: A file can't be read.
        DataError: A file's rows can't be a recording.
        UsageError: An answer fits none of the files.
        MissingSignalError: Nothing in the files is a quantity; an `AmbiguousError` asks what only the user knows.
    """
    files, answers = _split_files_and_helping_answers(files, answers)
    kinds = {path: find_kind_name(path) for path in files}
    tables: list[SourceTable] = []
    recordings: list[Recording] = []
    for path, kind in kinds.items():
        for each in load_kind(kind).read(path, answers):
            if isinstance(each, SourceTable):
                tables.append(each)
            else:
                recordings.append(each)
    answers = check_answers(answers, [*tables, *recordings])
    meanings, unused = _interpret_tables_with_quantities(tables, answers)
    _find_quantities_of_all_tables(meanings)
    questions = [question for meaning in meanings for question in meaning.questions]
    if questions:
        raise questions[0].as_error(questions[1:])
    _raise_question_about_missing_start_time(meanings)
    channels = [(meaning.name, channel) for meaning in meanings for channel in channels_of_table(meaning)]
    _raise_question_about_repeated_quantities(channels)
    if not channels and not recordings:
        raise _no_quantity_error(", ".join(files), tables)
    guesses = [(meaning.name, tuple(meaning.guesses)) for meaning in meanings if len(meaning.guesses) > 1]
    guesses += [(each.name, tuple(each.guesses)) for each in recordings]
    notes = {meaning.name: (*meaning.table.source.notes, *meaning.notes) for meaning in meanings}
    for meaning in meanings:
        used = {guess.column for guess in meaning.guesses}
        loaded = {column for columns in meaning.table.candidates.values() for column in columns}
        unused[meaning.name] = (*meaning.table.unused, *sorted(loaded - used))
    return ImportPlan(kinds, tuple(guesses), tuple(channels), tuple(recordings), notes, unused, answers)


def _split_files_and_helping_answers(files: Sequence[str], answers: Answers) -> tuple[list[str], Answers]:
    """Return the files without those that explain others: DBC files, and a file of times."""
    dbc, times, others = [], [], []
    for path in dict.fromkeys(files):
        head = FileHead(path)
        if any(line.startswith(("BO_ ", "BU_:", "NS_ :")) for line in head.lines):
            dbc.append(path)
        elif is_one_number_per_line(head):
            times.append(path)
        else:
            others.append(path)
    if not others and files:
        raise MissingSignalError(
            "it only explains another file", where=", ".join(files), hint="name the trace, the poses or the video, too"
        )
    if len(times) > 1:
        raise Question(times[0], f"{len(times)} files hold one time a line", "--times FILE names one").as_error()
    return others, replace(
        answers, dbc=(*answers.dbc, *dbc), frame_times=answers.frame_times or (times[0] if times else "")
    )


def _interpret_tables_with_quantities(
    tables: Sequence[SourceTable], answers: Answers
) -> tuple[list[Meaning], dict[str, tuple[str, ...]]]:
    """Return the tables that hold a quantity, with their stamps; and the columns of those that hold none."""
    meanings, unused, questions = [], {}, []
    for table in tables:
        loaded = load_table(table, answers)
        if not _has_candidate_of_quantity(loaded.candidates):
            if len(tables) == 1:
                raise _no_quantity_error(table.name, tables)
            unused[table.name] = table.columns
            continue
        try:
            meanings.append(interpret_times_of_table(loaded, answers))
        except AmbiguousError as error:
            questions.append(Question(error.where, error.what, error.hint))
    if questions:
        raise questions[0].as_error(questions[1:])
    return meanings, unused


def _no_quantity_error(where: str, tables: Sequence[SourceTable]) -> MissingSignalError:
    columns = tuple(column for table in tables for column in table.columns)
    hint = f"--column QUANTITY=COLUMN*UNIT; quantities: {', '.join(COLUMN_WORDS_BY_QUANTITY)}"
    mixed = next(
        (each for each in columns if MIXED_SEPARATORS_PATTERN.fullmatch(each[:MAX_LOOKED_AT_CHARACTERS])), None
    )
    if mixed is not None:
        hint = f"{mixed!r} may be several columns: put the same separator between all of them"
    return MissingSignalError(
        "no column is a position, a speed, a heading or an inertial measurement",
        where=where,
        found=columns[:40],
        hint=hint,
    )


def _has_candidate_of_quantity(candidates: Mapping[str, Sequence[str]]) -> bool:
    return any(
        name
        for name in candidates
        if COLUMN_WORDS_BY_QUANTITY[name].kind not in {"time", "text", "number"} and name not in {"altitude", "z"}
    )


def _find_quantities_of_all_tables(meanings: Sequence[Meaning]) -> None:
    """Find the quantities of all tables: positions first, because they judge the others."""
    for meaning in meanings:
        keep_rows_of_one_vehicle(meaning)
        if not meaning.questions:
            require_rows_of_one_recording(meaning)
            find_positions_and_track(meaning)
            _add_orientation_quaternion_of_pose(meaning)
            rotate_poses_into_car_axes(meaning)
    accelerations = acceleration_table_by_turn_rate_table(meanings)
    paired = {each.name for each in accelerations.values()}
    for meaning in meanings:
        if meaning.questions:
            continue
        track = meaning.track or _track_of_other_table_or_none(meaning, meanings)
        find_speed_and_unit(meaning, track)
        find_velocity(meaning, track)
        find_headings(meaning, track)
        find_yaw_rate(meaning, track)
        if meaning.name not in paired:
            find_accelerations_and_turn_rates(meaning, track, accelerations.get(meaning.name))
        _add_steering_if_user_gave_unit(meaning)


def _track_of_other_table_or_none(meaning: Meaning, meanings: Sequence[Meaning]) -> TrackSpans | None:
    """Return the track of another table on the same clock."""
    return next((each.track for each in meanings if each.track is not None and each.since == meaning.since), None)


def _add_steering_if_user_gave_unit(meaning: Meaning) -> None:
    """Take a steering angle that the user names; by its name it may be the wheel's or that of the steering wheel."""
    column = meaning.choose_column_or_ask("steering") if meaning.candidate_columns("steering") else None
    if column is None:
        return
    choice = meaning.stated_unit("steering", column)
    if meaning.is_decided_by_user("steering") and choice.unit:
        meaning.add_scaled_quantity("steering", column, choice)
    else:
        meaning.notes.append(
            f"{column!r} is left out: it may be the angle of the steering wheel "
            f"(--column steering='{column}*deg' if it is that of the road wheels)"
        )


def _add_orientation_quaternion_of_pose(meaning: Meaning) -> None:
    """Take a quaternion beside x and y as the orientation of the pose."""
    if "x" not in meaning.values:
        return
    columns = [meaning.choose_column_or_ask(f"quaternion_{axis}") for axis in "xyzw"]
    for axis, column in zip("xyzw", columns, strict=True):
        if all(columns) and column is not None:
            guess = Guess(f"quaternion_{axis}", column, "", "certain", "the name")
            meaning.add_quantity(
                f"quaternion_{axis}",
                meaning.numbers_in_file_unit(column) * FACTOR_BY_KIND_AND_UNIT["number"]["1"],
                guess,
            )


def _raise_question_about_repeated_quantities(channels: Sequence[tuple[str, OutputChannel]]) -> None:
    """Ask which table to read where two hold the same quantity: a log with both could be read either way."""
    first: dict[str, str] = {}
    questions = []
    for table, channel in channels:
        other = first.setdefault(channel.topic, table)
        if other != table:
            quantities = REQUIRED_QUANTITIES_BY_TOPIC[channel.topic]
            choices = " or ".join(
                " ".join(f"--column '{quantity}@{name}='" for quantity in quantities) for name in (other, table)
            )
            what = f"{other} holds the same: {', '.join(quantities)}"
            questions.append(Question(table, what, f"{choices} leaves one out"))
    if questions:
        raise questions[0].as_error(questions[1:])


def _raise_question_about_missing_start_time(meanings: Sequence[Meaning]) -> None:
    """Ask for the start of tables whose times count from it, beside tables that know the time."""
    absolute = [meaning for meaning in meanings if meaning.since == "1970"]
    relative = [meaning for meaning in meanings if meaning.since == "start"]
    if absolute and relative:
        raise Question(
            relative[0].name,
            f"its times count from the start of the recording, and those of {absolute[0].name} from 1970",
            "--start 2024-05-01T08:00:00Z says when the recording started",
        ).as_error()


def write_import(
    plan: ImportPlan,
    target: str,
    *,
    mapping_file: str | None = None,
    force: bool = False,
    inputs: Sequence[InputFile] = (),
) -> None:
    """Write the log, and the mapping file, both or none; none if an input has changed since it was opened.

    Raises:
        InputError: An input has changed.
        OutputError: One can't be written.
    """
    from cwcli.logs.write.writer import LogWriter
    from cwcli.output import AtomicGroup, open_output, write_file

    with AtomicGroup() as together:
        if mapping_file is not None:
            write_file(mapping_file, plan.mapping_text().encode(), force=force, together=together)
        with open_output(target, force=force, together=together) as output, LogWriter(output) as log:
            for _, channel in plan.channels:
                log.write_columns(channel)
            for recording in plan.recordings:
                recording.write(log)
            log.add_metadata(METADATA_NAME, {"files": ", ".join(plan.kinds), "mapping": plan.mapping_text()})
            for each in inputs:
                each.check_unchanged()
            log.close()
