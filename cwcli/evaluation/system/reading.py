"""Read another system's channel as a signal, with a note on unusable messages."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.errors import UsageError
from cwcli.evaluation.evaluation_context import EvaluationContext
from cwcli.signals.build import build_signal, require_usable_rows
from cwcli.signals.canonical import Signal
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.role import Role
from cwcli.text import escape_control_characters, format_count


def read_signal_of_other_system(
    context: EvaluationContext, role_name: str, topic: str, roles: Sequence[Role]
) -> Signal:
    """Read a topic that is named for a role of another system.

    Args:
        context: The log; receives notes on unusable messages.
        role_name: Name of the role in `--topic`.
        roles: Input roles whose builders can read it, the preferred one first.

    Raises:
        UsageError: No builder of the roles can read its messages.
        DataError: None of its messages can be used.
        MissingSignalError: It has no message.
    """
    log = context.log
    schemas = {channel.topic: channel.schema_name for channel in log.channels}
    usable = {
        each: role
        for each, schema in schemas.items()
        for role in reversed(roles)
        if find_input_for_role(role, schema) is not None
    }
    if topic not in usable:
        raise UsageError(
            f"--topic {role_name}={topic}: {schemas[topic] or 'no schema'} can't be read as {role_name}",
            where=log.name,
            found=tuple(f"{each} ({schemas[each]})" for each in usable) or ("no topic that can",),
        )
    entry = find_input_for_role(usable[topic], schemas[topic])
    encoding = next(channel.message_encoding for channel in log.channels if channel.topic == topic)
    assert entry is not None
    columns = log.columns(topic, entry.fields.get(encoding, ()))
    signal, quality = build_signal(usable[topic], columns, is_override=True)
    require_usable_rows(quality, where=log.name)
    if quality.rejected:
        reasons = ", ".join(f"{n} {reason}" for reason, n in quality.rejected.items())
        context.notes.append(
            f"{escape_control_characters(topic)}: of {format_count(quality.read, 'message')} not used: {reasons}"
        )
    return signal
