"""Opens logs of several files: a folder as rosbag2 writes it, or parts that the user names together.

Format: https://github.com/ros2/rosbag2/blob/rolling/rosbag2_storage/src/rosbag2_storage/metadata_io.cpp
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import field
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from cwcli.errors import InputError, UsageError
from cwcli.input import InputFile, read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.format.joined_file import JoinedFile
from cwcli.logs.read.remote import file_names_below_url, is_remote_url, iter_remote_blocks
from cwcli.url import display_name_of_url

METADATA_FILE_NAME = "metadata.yaml"
"""The file in which rosbag2 lists the parts of a recording."""
LOG_FILE_SUFFIXES = (".mcap", ".mcap.zstd", ".mcap.zst", ".db3", ".db3.zstd", ".bag")
"""The suffixes of log files, in lower case."""
MAX_METADATA_FILE_BYTES = 16_000_000
"""The greatest size in bytes of a metadata.yaml. Chosen by hand."""
UNREAD_JOURNALS_NOTE = "write-ahead logs that are not read, as the databases are not on this machine"
"""The note about journals of remote databases."""
MAX_METADATA_YAML_VALUES = 100_000
"""The greatest number of values in a metadata.yaml. Chosen by hand: a recording of 5,000 parts and 1,000 topics has
fewer."""
MAX_PATH_CHARS = 4096
"""The greatest length of a path on Linux (`PATH_MAX`)."""
MAX_DIGITS_OF_MESSAGE_COUNT = 19
"""The greatest number of digits in a number of messages: as many as 2^63 has."""
YAML_NULL_TEXTS = ("", "~", "null")
"""The texts that stand for null in YAML 1.2."""
Opener = Callable[[str], InputFile]
MAX_YAML_DEPTH = 64
"""The greatest depth of lists and mappings inside each other. Chosen by hand."""


class ExpandedSize(NamedTuple):
    """The size of a part of a document with every alias expanded.

    Attributes:
        nodes: Number of scalars, lists and mappings.
        chars: Number of characters of its scalars.
    """

    nodes: int = 0
    chars: int = 0


@dataclass(frozen=True)
class RecordingListing:
    """The content of a folder's metadata.yaml.

    Attributes:
        files: Name of each part -> number of its messages, None if it does not say.
        n_messages: Number of messages in all parts, or None.
        faults: Faults of the file, as text -> how often.
    """

    files: dict[str, int | None] = field(default_factory=dict)
    n_messages: int | None = None
    faults: dict[str, int] = field(default_factory=dict)


def is_recording_folder(folder: Path) -> bool:
    """Tell whether a folder is one log: it holds a recorder's metadata.yaml and at least one log file."""
    return (folder / METADATA_FILE_NAME).is_file() and bool(log_names_in_folder(folder))


def log_names_in_folder(folder: Path) -> list[str]:
    """Return the names of the log files directly in a folder, sorted by their numbers.

    Raises:
        InputError: It can't be listed.
    """
    return _log_names_in_part_order(_file_names_in_folder(folder))


def _file_names_in_folder(folder: Path) -> list[str]:
    try:
        return names_of_entries(folder, os.DirEntry.is_file)
    except OSError as error:
        raise InputError(f"the folder can't be listed: {error.strerror}", where=str(folder)) from error


def names_of_entries(folder: Path, is_wanted: Callable[[os.DirEntry[str]], bool]) -> list[str]:
    """Return the names of those entries of a folder that are wanted; a link that leads to itself is none.

    Args:
        folder: The folder.
        is_wanted: `os.DirEntry.is_file` or `os.DirEntry.is_dir`.

    Raises:
        OSError: The folder can't be listed.
    """
    names = []
    with os.scandir(folder) as entries:  # a `Path` of each takes several times as long
        for each in entries:
            with suppress(OSError):
                if is_wanted(each):
                    names.append(each.name)
    return names


def _log_names_in_part_order(names: Sequence[str]) -> list[str]:
    """Return the names with a suffix of a log file, sorted by their numbers."""
    return sorted((each for each in names if each.lower().endswith(LOG_FILE_SUFFIXES)), key=_sort_key_by_part_number)


def _sort_key_by_part_number(name: str) -> tuple[str, int, str]:
    """Return a sort key: the name's stem without its final number, that number, and the name."""
    stem = name.split(".", 1)[0]
    head = stem.rstrip("0123456789")
    return head, int(stem[len(head) :][:18] or 0), name


def open_recording_folder(folder: str, name: str, open_file: Opener, *, as_one: bool) -> InputFile:
    """Open the log in a folder: the files of its metadata.yaml, or all files (`as_one`), or the only one.

    Args:
        folder: The folder, or its URL.
        name: Name for messages.
        open_file: Opens one file by its name.
        as_one: Without a metadata.yaml, join all log files of the folder.

    Raises:
        InputError: It holds no log, or several without `as_one`, or one can't be read.
    """
    everything = file_names_below_url(folder) if is_remote_url(folder) else _file_names_in_folder(Path(folder))
    names = _log_names_in_part_order(everything)
    prefix = f"{folder.rstrip('/')}/" if folder != "/" else folder
    if not names:
        deeper = (
            None if is_remote_url(folder) else next(iter(sorted(Path(folder).glob(f"*/{METADATA_FILE_NAME}"))), None)
        )
        hint = "name a log in it" if deeper is None else f"there is a recording in {deeper.parent}"
        raise InputError("the folder holds no log", where=name, hint=hint)
    unread = [each for each in everything if is_remote_url(folder) and each.removesuffix("-wal") != each]
    if METADATA_FILE_NAME not in everything:
        if len(names) == 1:
            file = open_file(prefix + names[0])
            _add_note_with_names(file.notes, UNREAD_JOURNALS_NOTE, unread)
            return file
        if not as_one:
            hint = "--as-one reads them as the parts of one log; or name one of them (`cwcli run -d` takes many)"
            raise InputError(f"the folder holds {len(names)} logs and no {METADATA_FILE_NAME}", where=name, hint=hint)
        return open_parts([prefix + each for each in names], name, open_file)
    listing = read_recording_listing(prefix + METADATA_FILE_NAME)
    present = frozenset(names)
    found = {listed: actual_name for listed in listing.files if (actual_name := _find_listed_file(listed, present))}
    if not found:
        if listing.files:
            what = f"none of the {len(listing.files)} logs that its {METADATA_FILE_NAME} lists exists"
            raise InputError(what, where=name, found=tuple(names), hint="name the logs with --as-one")
        found = {each: each for each in names}
    notes = dict(listing.faults)
    _add_note_with_names(
        notes, f"parts missing that {METADATA_FILE_NAME} lists", [each for each in listing.files if each not in found]
    )
    if listing.files:
        _add_note_with_names(
            notes, f"logs that {METADATA_FILE_NAME} does not list, not read", sorted(set(names) - set(found.values()))
        )
    _add_note_with_names(notes, UNREAD_JOURNALS_NOTE, unread)
    file = open_parts([prefix + each for each in found.values()], name, open_file)
    file.notes = {**notes, **file.notes}
    file.listed_message_counts = {found.get(listed, listed): n for listed, n in listing.files.items()}
    file.n_listed_messages = listing.n_messages
    return file


def open_parts(names: Sequence[str], name: str, open_file: Opener) -> JoinedFile:
    """Open files as the parts of one log; empty files are noted and left out.

    Raises:
        InputError: One can't be read, or all are empty.
        UsageError: Standard input is among them.
    """
    notes: dict[str, int] = {}
    parts: list[InputFile] = []
    with ExitStack() as stack:
        empty = []
        for each in names:
            if each == "-":
                raise UsageError("standard input can't be a part of a log", hint="name the files")
            if _is_empty_file(each):
                empty.append(Path(each).name)
                continue
            parts.append(open_file(each))
            stack.callback(parts[-1].close)
        _add_note_with_names(notes, "empty parts", empty)
        if not parts:
            raise InputError("all of its parts are empty", where=name)
        file = JoinedFile(parts, name)
        stack.pop_all()
    file.notes = notes
    return file


def _is_empty_file(name: str) -> bool:
    try:
        path = Path(name)
        return path.is_file() and path.stat().st_size == 0
    except (OSError, ValueError):
        return False


def name_of_joined_log(names: Sequence[str]) -> str:
    """Return a name for a log of these parts, for messages."""
    first = display_name_of_url(names[0])
    return f"{first} and {len(names) - 1} more" if len(names) > 1 else first


def _find_listed_file(listed: str, names: Collection[str]) -> str | None:
    """Return the file for a listed name, which may have been compressed or decompressed since, or None."""
    stem = listed.removesuffix(".zstd").removesuffix(".zst")
    return next((each for each in (listed, stem, f"{stem}.zstd", f"{stem}.zst") if each in names), None)


def _add_note_with_names(notes: dict[str, int], what: str, names: Sequence[str]) -> None:
    """Add a note that lists the first of these names, if there are any."""
    if names:
        shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        notes[f"{what} ({shown})"] = len(names)


def read_recording_listing(source: str) -> RecordingListing:
    """Read a metadata.yaml by its path or URL.

    The listing of one that can't be understood is empty and names the fault.
    """
    import yaml

    try:
        pieces = (
            iter_remote_blocks(source)
            if is_remote_url(source)
            else iter([read_file(source, MAX_METADATA_FILE_BYTES + 1)])
        )
        text = b""
        for piece in pieces:
            text += piece
            if len(text) > MAX_METADATA_FILE_BYTES:
                raise ValueError("it is too large")
        document = load_yaml(text, max_nodes=MAX_METADATA_YAML_VALUES, max_chars=MAX_METADATA_FILE_BYTES)
        return _parse_listing(document["rosbag2_bagfile_information"])
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError, yaml.YAMLError):
        return RecordingListing(faults={f"{METADATA_FILE_NAME} that can't be understood": 1})


def _parse_listing(information: Mapping[str, Any]) -> RecordingListing:
    """Return the listing of a parsed document, in which every scalar is text.

    Raises:
        AttributeError, KeyError, TypeError, ValueError: The document has another structure.
    """
    faults: dict[str, int] = {}
    counts: dict[str, int | None] = {}
    repeated: list[str] = []
    for listed in _list_or_empty_at_key(information, "relative_file_paths"):
        name = _last_path_part(listed)
        if name in counts:
            repeated.append(name)
        counts[name] = None
    for entry in _list_or_empty_at_key(information, "files") if "files" in information else ():
        name = _last_path_part(entry["path"])
        if name in counts:
            counts[name] = _parse_message_count(entry.get("message_count"))
    _add_note_with_names(faults, f"parts that {METADATA_FILE_NAME} lists twice", repeated)
    return RecordingListing(counts, _parse_message_count(information.get("message_count")), faults)


def _list_or_empty_at_key(information: Mapping[str, Any], key: str) -> list[Any]:
    """Return the list under a key; null is an empty list.

    Raises:
        KeyError, TypeError: It is missing, or not a list.
    """
    found = information[key]
    if isinstance(found, str) and found in YAML_NULL_TEXTS:
        return []
    if not isinstance(found, list):
        raise TypeError(f"{key} is no list")
    return found


def _last_path_part(listed: object) -> str:
    """Return the last part of a path: before ROS 2 Galactic paths began with the folder's own name.

    Raises:
        TypeError: It is not a text, or too long.
    """
    if not isinstance(listed, str) or len(listed) > MAX_PATH_CHARS:
        raise TypeError("a file has no usable name")
    return PurePosixPath(listed).name


def _parse_message_count(value: object) -> int | None:
    """Return a number of messages from its text; None if it is not a number."""
    is_number = (
        isinstance(value, str) and len(value) <= MAX_DIGITS_OF_MESSAGE_COUNT and value.isascii() and value.isdigit()
    )
    return int(value) if is_number else None  # type: ignore[call-overload]


def load_yaml(text: bytes, *, max_nodes: int, max_chars: int, max_depth: int = MAX_YAML_DEPTH) -> Any:
    """Load a document of unknown origin as dicts, lists and texts, after a check of its expanded size.

    A few hundred bytes of YAML can expand to gigabytes: an alias repeats what an anchor names, which may contain
    aliases itself. The events of the parser are counted first, each alias with its expanded size; only a document
    within the bounds is loaded. Every scalar stays text: numbers, times, merge keys and tags, which cost more or run
    code in other loaders, are not interpreted.

    Args:
        text: One YAML document.
        max_nodes: Greatest number of values, with every alias expanded.
        max_chars: Greatest number of characters of all values, with every alias expanded.
        max_depth: Greatest depth of lists and mappings inside each other.

    Raises:
        ValueError: It exceeds a bound.
        yaml.YAMLError: It is not YAML.
    """
    import yaml

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    measure_expanded_size(yaml.parse(text, loader), max_nodes=max_nodes, max_chars=max_chars, max_depth=max_depth)
    return yaml.load(text, loader)


def measure_expanded_size(events: Iterable[Any], *, max_nodes: int, max_chars: int, max_depth: int) -> ExpandedSize:
    """Return the expanded size of a document from its events, and check it against the bounds on the way.

    Args:
        events: From `yaml.parse`; no more are read than the bounds allow.
        max_nodes, max_chars, max_depth: The bounds; see `load_yaml`.

    Raises:
        ValueError: The document exceeds a bound, or an alias has no anchor before it or lies inside its own.
    """
    import yaml

    total = ExpandedSize()
    sizes: dict[str, ExpandedSize] = {}
    begun: list[tuple[str | None, ExpandedSize]] = []
    for event in events:
        before = total
        if isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, before))
            if event.anchor is not None:
                sizes.pop(event.anchor, None)
            total = ExpandedSize(total.nodes + 1, total.chars)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            if anchor is not None:
                sizes[anchor] = ExpandedSize(total.nodes - before.nodes, total.chars - before.chars)
        elif isinstance(event, yaml.ScalarEvent):
            total = ExpandedSize(total.nodes + 1, total.chars + len(event.value))
            if event.anchor is not None:
                sizes[event.anchor] = ExpandedSize(1, len(event.value))
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError("an alias names nothing that is complete before it")
            total = ExpandedSize(*(sum(pair) for pair in zip(total, sizes[event.anchor], strict=True)))
        if total.nodes > max_nodes or total.chars > max_chars or len(begun) > max_depth:
            raise ValueError("it is nested too deep, or stands for too much")
    return total
