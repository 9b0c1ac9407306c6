"""The fields of a channel that no role takes, from its first messages: what they hold, and what to try with them."""

from __future__ import annotations

from cwcli.channels.reasons import (
    FIELDS_NOT_SEARCHED_TEXT,
    UNKNOWN_TYPE_TEXT,
    FieldKind,
    UnboundReason,
    explain_unknown_type_by_fields,
    format_system_warning_command_if_readable,
    warning_condition_of_diagnostics_or_empty,
)
from cwcli.errors import CwcliError, InputError
from cwcli.logs.codecs.ros2msg import SchemaError
from cwcli.logs.format.records import ChunkIndex
from cwcli.logs.read.reader import Log

MAX_MESSAGES_READ_PER_CHANNEL = 5
"""Greatest number of messages of a channel that are read for its fields: the first may lack optional ones. Chosen by
hand."""
MAX_BYTES_OF_READ_MESSAGE = 1 << 16
"""Largest message that is read for its fields, 64 KiB; images and point clouds are larger. Chosen by hand."""
MAX_CHANNELS_READ_FOR_FIELDS = 50
"""Greatest number of channels of a log whose messages are read for their fields. Chosen by hand."""
MAX_BYTES_UNPACKED_FOR_FIELDS = 500_000_000
"""Fewer channels are read where each may unpack a chunk so large that they would exceed this. Chosen by hand."""
MAX_FIELDS_LISTED_PER_MESSAGE = 200
"""Greatest number of fields of a message that are listed. Chosen by hand."""
MAX_NESTING_SEARCHED_FOR_FIELDS = 8
"""Greatest nesting of a message that is searched for fields. Chosen by hand."""


def complete_reasons_of_unknown_channels(log: Log, reasons: dict[str, UnboundReason]) -> None:
    """Complete the reasons of channels of unknown types by the fields of their first messages.

    Args:
        reasons: Topic -> why it fills no role; changed in place.
    """
    schemas = {channel.topic: channel.schema_name for channel in log.channels}
    unknown = [topic for topic, reason in reasons.items() if reason.why == UNKNOWN_TYPE_TEXT and not reason.fields]
    diagnostics = [topic for topic in reasons if schemas[topic].endswith("/DiagnosticArray")]
    n_read = _count_channels_to_read(log)
    n_unknown_read = max(n_read - len(diagnostics), 1)
    for topic in unknown[n_unknown_read:]:
        reasons[topic] = UnboundReason(FIELDS_NOT_SEARCHED_TEXT)
    for topic in [*diagnostics[:n_read], *unknown[:n_unknown_read]]:
        try:
            trees = log.first_message_trees(topic, MAX_MESSAGES_READ_PER_CHANNEL, MAX_BYTES_OF_READ_MESSAGE)
        except InputError as error:
            if isinstance(error.__cause__, SchemaError):
                reasons[topic] = UnboundReason(f"{reasons[topic].why}, and it can't be read: {error.what}")
            continue
        except CwcliError:  # the log is damaged, which the commands that need it say
            continue
        if topic in diagnostics:
            condition = warning_condition_of_diagnostics_or_empty(trees)
            tries = tuple(format_system_warning_command_if_readable(topic, condition)) if condition else ()
            reasons[topic] = reasons[topic]._replace(tries=(*reasons[topic].tries, *tries))
        elif kinds := field_kinds_of_trees(trees):
            reasons[topic] = explain_unknown_type_by_fields(topic, kinds)


def _count_channels_to_read(log: Log) -> int:
    """Count the channels whose first messages may be read, each of which may be in the largest chunk."""
    most = log.file.max_chunk_bytes  # a larger one is not unpacked
    sizes = (each.uncompressed_size for each in log.index.items_of_type(ChunkIndex))
    largest = max((each for each in sizes if each <= most), default=0)
    return max(min(MAX_CHANNELS_READ_FOR_FIELDS, MAX_BYTES_UNPACKED_FOR_FIELDS // max(largest, 1)), 1)


def field_kinds_of_trees(trees: list[object]) -> dict[str, FieldKind]:
    """Return path -> kind of the leaf fields of decoded messages; of a list of numbers, the first element."""
    found: dict[str, FieldKind] = {}
    for tree in trees:
        _add_field_kinds(tree, "", found, 0)
    return found


def _add_field_kinds(value: object, path: str, kind_by_path: dict[str, FieldKind], depth: int) -> None:
    """Add the leaf fields of a part of a message; those of lists of messages are left out."""
    if len(kind_by_path) >= MAX_FIELDS_LISTED_PER_MESSAGE or depth > MAX_NESTING_SEARCHED_FOR_FIELDS:
        return
    if isinstance(value, dict):
        for name, part in value.items():
            _add_field_kinds(part, f"{path}.{name}" if path else str(name), kind_by_path, depth + 1)
    elif isinstance(value, bool) and path:
        kind_by_path.setdefault(path, "truth value")
    elif isinstance(value, int | float) and path:
        kind_by_path.setdefault(path, "number")
    elif isinstance(value, str) and path:
        kind_by_path.setdefault(path, "text")
    elif isinstance(value, list) and value and isinstance(value[0], int | float):
        _add_field_kinds(value[0], f"{path}[0]", kind_by_path, depth + 1)
