"""The kinds of files that can be imported: one file each, and one line here, the most particular first."""

from __future__ import annotations

from importlib import import_module

from cwcli.errors import InputError
from cwcli.importing.readers.base import FileHead, ImportKind
from cwcli.importing.text_file import no_text_error

KIND_MODULES = {
    "csv": "csv_table",
}
"""Name of a kind -> module with its `KIND`, in the order in which a file is compared with them."""


def load_kind(name: str) -> ImportKind:
    """Return a kind by its name."""
    kind: ImportKind = import_module(f"cwcli.importing.readers.{KIND_MODULES[name]}").KIND
    return kind


def find_kind(path: str) -> str:
    """Return the name of a file's kind.

    Raises:
        InputError: It can't be read, is empty, or is of no kind that is known.
    """
    head = FileHead(path)
    if not head.data:
        raise InputError("it is empty", where=path)
    for name in KIND_MODULES:
        if load_kind(name).accepts(head):
            return name
    raise no_text_error(path)
