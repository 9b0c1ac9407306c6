"""A log that is several files: a folder as rosbag2 writes it, or parts that are named together.

Format: https://github.com/ros2/rosbag2/blob/rolling/rosbag2_storage/src/rosbag2_storage/metadata_io.cpp
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from cwcli.errors import InputError, UsageError
from cwcli.input import InputFile, read_file
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.read.bounded_yaml import load_yaml
from cwcli.logs.read.remote import blocks, is_remote, names_below
from cwcli.url import name_url

METADATA = "metadata.yaml"
SUFFIXES = (".mcap", ".mcap.zstd", ".mcap.zst", ".db3", ".db3.zstd", ".bag")
"""What logs are called."""
MAX_METADATA_BYTES = 16_000_000
UNREAD_JOURNALS = "write-ahead logs that are not read, as the databases are not on this machine"
MAX_METADATA_NODES = 100_000
"""Values in a metadata.yaml: a recording of 5,000 parts and 1,000 topics has fewer."""
MAX_PATH_CHARS = 4096
"""Of a path on Linux (`PATH_MAX`)."""
MAX_DIGITS = 19
"""Of a number of messages: as many as 2^63 has."""
YAML_NULLS = ("", "~", "null")

Opener = Callable[[str], InputFile]


@dataclass(frozen=True)
class Listing:
    """What a folder's metadata.yaml says.

    Attributes:
        files: Name of each part -> its messages, None where it does not tell.
        n_messages: In all parts, or None.
        faults: What is wrong with it -> how often.
    """

    files: dict[str, int | None] = field(default_factory=dict)
    n_messages: int | None = None
    faults: dict[str, int] = field(default_factory=dict)


def is_recording(folder: Path) -> bool:
    """Whether a folder is one log: a recorder's metadata.yaml is in it, and a log."""
    return (folder / METADATA).is_file() and bool(logs_in(folder))


def logs_in(folder: Path) -> list[str]:
    """The names of the logs right in a folder, by number where they have one.

    Raises:
        InputError: It can't be listed.
    """
    return _logs_among(_names_in(folder))


def _names_in(folder: Path) -> list[str]:
    try:
        return [each.name for each in folder.iterdir() if each.is_file()]
    except OSError as error:
        raise InputError(f"the folder can't be listed: {error.strerror}", where=str(folder)) from error


def _logs_among(names: Sequence[str]) -> list[str]:
    return sorted((each for each in names if each.lower().endswith(SUFFIXES)), key=_by_number)


def _by_number(name: str) -> tuple[str, int, str]:
    stem = name.split(".", 1)[0]
    head = stem.rstrip("0123456789")
    return head, int(stem[len(head) :][:18] or 0), name


def open_folder(folder: str, name: str, opened: Opener, *, as_one: bool) -> InputFile:
    """A folder's log: that of its metadata.yaml, or all that lie in it (`as_one`), or the only one.

    Args:
        folder: The folder, or its URL.
        name: For messages.
        opened: Opens one file by its name.
        as_one: Without a metadata.yaml its logs are parts of one.

    Raises:
        InputError: It holds no log, or several, or one can't be read.
    """
    everything = names_below(folder) if is_remote(folder) else _names_in(Path(folder))
    names = _logs_among(everything)
    prefix = f"{folder.rstrip('/')}/" if folder != "/" else folder
    if not names:
        deeper = None if is_remote(folder) else next(iter(sorted(Path(folder).glob(f"*/{METADATA}"))), None)
        hint = "name a log in it" if deeper is None else f"a recording lies deeper: {deeper.parent}"
        raise InputError("the folder holds no log", where=name, hint=hint)
    unread = [each for each in everything if is_remote(folder) and each.removesuffix("-wal") != each]
    if METADATA not in everything:
        if len(names) == 1:
            file = opened(prefix + names[0])
            _note(file.notes, UNREAD_JOURNALS, unread)
            return file
        if not as_one:
            hint = "--as-one reads them as the parts of one log; else name one of them (`cwcli run -d` takes many)"
            raise InputError(f"the folder holds {len(names)} logs and no {METADATA}", where=name, hint=hint)
        return open_parts([prefix + each for each in names], name, opened)
    listing = read_listing(prefix + METADATA)
    found = {listed: there for listed in listing.files if (there := _found(listed, names))}
    if not found:
        if listing.files:
            what = f"none of the {len(listing.files)} logs of its {METADATA} is there"
            raise InputError(what, where=name, found=tuple(names), hint="name the logs with --as-one")
        found = {each: each for each in names}
    notes = dict(listing.faults)
    _note(notes, f"parts missing that {METADATA} lists", [each for each in listing.files if each not in found])
    if listing.files:
        _note(notes, f"logs beside those of {METADATA}, not read", sorted(set(names) - set(found.values())))
    _note(notes, UNREAD_JOURNALS, unread)
    file = open_parts([prefix + each for each in found.values()], name, opened)
    file.notes = {**notes, **file.notes}
    file.listing = {found.get(listed, listed): n for listed, n in listing.files.items()}
    file.n_listed = listing.n_messages
    return file


def open_parts(names: Sequence[str], name: str, opened: Opener) -> JoinedFile:
    """Files as parts of one log; those without a byte are noted and left out.

    Raises:
        InputError: One can't be read, or none holds anything.
        UsageError: Standard input is among them.
    """
    notes: dict[str, int] = {}
    parts: list[InputFile] = []
    with ExitStack() as stack:
        empty = []
        for each in names:
            if each == "-":
                raise UsageError("standard input can't be a part of a log", hint="name the files")
            if _is_empty(each):
                empty.append(Path(each).name)
                continue
            parts.append(opened(each))
            stack.callback(parts[-1].close)
        _note(notes, "parts without a byte", empty)
        if not parts:
            raise InputError("all of its parts are empty", where=name)
        file = JoinedFile(parts, name)
        stack.pop_all()
    file.notes = notes
    return file


def _is_empty(name: str) -> bool:
    try:
        path = Path(name)
        return path.is_file() and path.stat().st_size == 0
    except (OSError, ValueError):
        return False


def joined_name(names: Sequence[str]) -> str:
    """What a log of these parts is called."""
    first = name_url(names[0])
    return f"{first} and {len(names) - 1} more" if len(names) > 1 else first


def _found(listed: str, names: Sequence[str]) -> str | None:
    """The file of a listed name, which may have been compressed or decompressed since."""
    stem = listed.removesuffix(".zstd").removesuffix(".zst")
    return next((each for each in (listed, stem, f"{stem}.zstd", f"{stem}.zst") if each in names), None)


def _note(notes: dict[str, int], what: str, names: Sequence[str]) -> None:
    if names:
        shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        notes[f"{what} ({shown})"] = len(names)


def read_listing(source: str) -> Listing:
    """What a metadata.yaml says of the files beside it.

    One that can't be understood is a fault, as is a name that points elsewhere.
    """
    import yaml

    try:
        pieces = blocks(source) if is_remote(source) else iter([read_file(source, MAX_METADATA_BYTES + 1)])
        text = b""
        for piece in pieces:
            text += piece
            if len(text) > MAX_METADATA_BYTES:
                raise ValueError("it is too large")
        document = load_yaml(text, max_nodes=MAX_METADATA_NODES, max_chars=MAX_METADATA_BYTES)
        return _listing(document["rosbag2_bagfile_information"])
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, yaml.YAMLError):
        return Listing(faults={f"{METADATA} that can't be understood": 1})


def _listing(information: Mapping[str, Any]) -> Listing:
    """The listing of a parsed document, in which every scalar is text.

    Raises:
        AttributeError, KeyError, TypeError, ValueError: It is not what a recorder writes.
    """
    faults: dict[str, int] = {}
    counts: dict[str, int | None] = {}
    repeated: list[str] = []
    for listed in _entries(information, "relative_file_paths"):
        name = _file_name(listed)
        if name in counts:
            repeated.append(name)
        counts[name] = None
    for entry in _entries(information, "files") if "files" in information else ():
        name = _file_name(entry["path"])
        if name in counts:
            counts[name] = _count(entry.get("message_count"))
    _note(faults, f"parts that {METADATA} lists twice", repeated)
    return Listing(counts, _count(information.get("message_count")), faults)


def _entries(information: Mapping[str, Any], key: str) -> list[Any]:
    found = information[key]
    if isinstance(found, str) and found in YAML_NULLS:
        return []
    if not isinstance(found, list):
        raise TypeError(f"{key} is no list")
    return found


def _file_name(listed: object) -> str:
    """The last part of a path: before ROS 2 Galactic the folder's own name stood in front."""
    if not isinstance(listed, str) or len(listed) > MAX_PATH_CHARS:
        raise TypeError("a file has no usable name")
    return PurePosixPath(listed).name


def _count(value: object) -> int | None:
    is_number = isinstance(value, str) and len(value) <= MAX_DIGITS and value.isascii() and value.isdigit()
    return int(value) if is_number else None  # type: ignore[call-overload]
