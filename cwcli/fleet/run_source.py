"""Finds the run that an argument names: an output folder on this machine or in an object store.

Of a run in a store, the manifest and the metrics are copied; its annotated logs stay there, and are read by their URLs.
"""

from __future__ import annotations

import weakref
from pathlib import Path

from cwcli.errors import InputError
from cwcli.fleet.folder import (
    ANNOTATED_LOG_NAME,
    ENDED_LOG_STATUSES,
    LOGS_FOLDER,
    MANIFEST_NAME,
    RUN_TIMES_NAME,
    RecordedRun,
    read_output_folder,
)
from cwcli.fleet.remote_folder import (
    copy_remote_files,
    copy_remote_folder,
    make_working_folder,
    remove_working_folder,
)
from cwcli.fleet.tables import METRICS_TABLE, TABLE_FILE_SUFFIX
from cwcli.input import is_folder
from cwcli.logs.read.recording import LOG_FILE_SUFFIXES, is_recording_folder
from cwcli.logs.read.remote import WEB_PREFIXES, file_names_below_url, is_remote_url

FILES_OF_WHOLE_RUN = (MANIFEST_NAME, RUN_TIMES_NAME, f"{METRICS_TABLE}{TABLE_FILE_SUFFIX}")
"""The files of a run in a store that are read of all its logs."""


def read_run_or_none(source: str) -> RecordedRun | None:
    """Read the run whose output folder a name or a URL stands for; None if it stands for something else.

    Raises:
        InputError: The manifest is of another format, or a store does not send it.
        OutputError: The copies from a store can't be written.
        UsageError: The URL needs a package that is not installed.
    """
    if is_remote_url(source):
        return _read_run_in_store(source.rstrip("/")) if _may_be_folder(source) else None
    return read_output_folder(Path(source)) if is_folder_of_logs(source) else None


def is_folder_of_logs(source: str) -> bool:
    """Tell whether a name is that of a folder on this machine that is not one log in parts.

    Raises:
        InputError: A zero byte is in the name.
    """
    try:
        return source not in {"", "-"} and is_folder(source) and not is_recording_folder(Path(source))
    except ValueError as error:  # a zero byte in the name
        raise InputError(str(error), where=source) from error


def _may_be_folder(url: str) -> bool:
    return not url.startswith(WEB_PREFIXES) and not url.lower().endswith((*LOG_FILE_SUFFIXES, TABLE_FILE_SUFFIX))


def _read_run_in_store(url: str) -> RecordedRun | None:
    """Read a run in a store, if there is one; the copies of its files last as long as what is returned."""
    names = file_names_below_url(url)
    if MANIFEST_NAME not in names:
        return None
    copy, run = make_working_folder(), None
    try:
        copy_remote_files(url, [name for name in FILES_OF_WHOLE_RUN if name in names], copy)
        run = read_output_folder(copy, url)
        if run is not None and any(log.entry.get("status") not in ENDED_LOG_STATUSES for log in run.logs):
            # of a run that was killed, each log has an entry and tables of its own
            copy_remote_folder(url, copy, _is_file_of_unfinished_run)
            run = read_output_folder(copy, url)
        return run
    finally:
        if run is None:
            remove_working_folder(copy)
        else:
            weakref.finalize(run, remove_working_folder, copy)


def _is_file_of_unfinished_run(name: str) -> bool:
    return name.startswith(f"{LOGS_FOLDER}/") and not name.endswith(f"/{ANNOTATED_LOG_NAME}")
