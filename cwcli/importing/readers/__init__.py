"""The kinds of files that can be imported: one file each, and one line here, the most particular first."""

from __future__ import annotations

from importlib import import_module

from cwcli.errors import InputError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.readers.unread import refuse_unread_format
from cwcli.importing.text_file import no_text_error

DESCRIPTION_PLACE_BY_FILE_KIND = {
    "parquet": "parquet:KIND",
    "zip": "phone:KIND",
    "video": "video:KIND",
    "blf": "can_trace:BLF",
    "ubx": "ubx:KIND",
    "gpx": "gpx:KIND",
    "kml": "kml:KIND",
    "sumo fcd": "fcd:KIND",
    "candump": "can_trace:CANDUMP_KIND",
    "asc": "can_trace:ASC",
    "trc": "can_trace:TRC",
    "gnsslogger": "gnsslogger:KIND",
    "rtklib": "rtklib:KIND",
    "vbox": "vbox:KIND",
    "nmea": "nmea:KIND",
    "euroc": "euroc:KIND",
    "tum": "trajectory:TUM_TRAJECTORY_IMPORT_KIND",
    "kitti": "trajectory:KITTI_POSES_IMPORT_KIND",
    "csv": "csv_table:KIND",
}
"""Name of a kind -> its description in a module here, in the order in which a file is compared with them."""


def load_kind(name: str) -> ImportKind:
    """Return a kind by its name."""
    module, _, attribute = DESCRIPTION_PLACE_BY_FILE_KIND[name].partition(":")
    kind: ImportKind = getattr(import_module(f"cwcli.importing.readers.{module}"), attribute)
    return kind


def find_kind_name(path: str) -> str:
    """Return the name of a file's kind.

    Raises:
        InputError: It can't be read, is empty, or is of no kind that is known.
    """
    head = FileHead(path)
    if not head.data:
        raise InputError("it is empty", where=path)
    refuse_unread_format(head)
    for name in DESCRIPTION_PLACE_BY_FILE_KIND:
        if load_kind(name).accepts(head):
            return name
    raise no_text_error(path)
