"""Writes what a run has made: the annotated log and the tables, all of them or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from cwcli.array_memory import bounded_array_memory
from cwcli.lazy_dataclass import dataclass
from cwcli.output import AtomicGroup, make_folder, refuse_unwritable_targets

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log
    from cwcli.metrics.table import Table
    from cwcli.pipeline.channel_choice import ChannelChoice
    from cwcli.pipeline.execute import RunOutcome

STDOUT = "-"
"""The name of standard output."""


class WritableRun(Protocol):
    """A run whose results are in memory (`cwcli.library.result.Result`).

    Attributes:
        annotated: The log with what the stages have made.
        outcome: The stages' results.
        choice: Which channels are written.
    """

    annotated: Log
    outcome: RunOutcome
    choice: ChannelChoice


@dataclass(frozen=True)
class OutputFiles:
    """The files of a run.

    Attributes:
        annotated: The annotated log, or the folder of its parts; None: it is not written, `-`: standard output.
        tables: File -> a table that is written there.
        tables_folder: Folder for all tables of all stages, or None.
        replace: Leave out channels of an earlier run that the new ones replace.
        is_folder_of_parts: `annotated` is a folder, which gets the parts in which the log came.
        force: Overwrite files that exist.
    """

    annotated: str | None = None
    tables: Mapping[Path, Table] = field(default_factory=dict)
    tables_folder: str | None = None
    replace: bool = False
    is_folder_of_parts: bool = False
    force: bool = False

    def tables_by_file(self, result: WritableRun) -> dict[Path, Table]:
        """Return every table that is written, by its file."""
        if self.tables_folder is None:
            return dict(self.tables)
        folder = Path(self.tables_folder)
        return {
            **self.tables,
            **{folder / f"{name}.parquet": table for name, table in result.outcome.tables_by_name().items()},
        }


@dataclass(frozen=True)
class WrittenFiles:
    """The files that were written.

    Attributes:
        names: In the order in which they were written, without standard output.
        dropped_profile: The input's MCAP profile, if the annotated log could not keep it, else "".
    """

    names: tuple[str, ...]
    dropped_profile: str = ""


def write_outputs(
    result: WritableRun, files: OutputFiles, step: Callable[[str], None] = lambda text: None
) -> WrittenFiles:
    """Write the annotated log and the tables: all of them or none.

    Args:
        result: What is written.
        files: Where, and how.
        step: Called with a text when the log is written.

    Raises:
        OutputError: A file exists or can't be written, or the log holds such channels already.
        InputError: The log is damaged, or changed while it was read.
    """
    from cwcli.metrics.table import write_table

    tables = files.tables_by_file(result)
    refuse_unwritable_targets(
        [path for path in tables if path.parent.is_dir()], force=files.force
    )  # others are made below
    names: list[str] = []
    dropped_profile = ""
    with bounded_array_memory(), AtomicGroup() as together:
        if files.annotated is not None:
            step(f"writing {files.annotated}")
            names, dropped_profile = _write_annotated_log_get_files_and_dropped_profile(
                result, files, files.annotated, together
            )
        if files.tables_folder is not None:
            make_folder(files.tables_folder)
        for path, table in tables.items():
            write_table(table, path, force=files.force, together=together)
    return WrittenFiles((*(name for name in names if name != STDOUT), *map(str, tables)), dropped_profile)


def _write_annotated_log_get_files_and_dropped_profile(
    result: WritableRun, files: OutputFiles, target: str, together: AtomicGroup
) -> tuple[list[str], str]:
    """Write the annotated log; return the names of its files, and the profile that it could not keep or ""."""
    from cwcli.logs.write.annotate import CopyOptions, annotate_log, annotate_parts

    if files.is_folder_of_parts:
        parts = annotate_parts(
            result.annotated,
            target,
            replace=files.replace,
            force=files.force,
            chosen_topics=result.choice,
            together=together,
        )
        return list(map(str, parts)), ""
    report = annotate_log(
        result.annotated,
        (),
        {},
        target,
        replace=files.replace,
        force=files.force,
        options=CopyOptions(chosen_topics=result.choice, together=together),
    )
    return [target], report.dropped_profile
