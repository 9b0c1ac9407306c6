"""Explains from topics, schemas and field names why a channel fills no role, and suggests options; reads no message."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from cwcli.channels.binding import ROLES_WITH_MANY_TOPICS, TRUTH_ROLES, Bindings, ChannelLike, is_truth_topic
from cwcli.channels.published import OWN_TOPIC_PREFIX
from cwcli.signals.input_rows import CAN_FRAME_SCHEMAS
from cwcli.signals.inputs import inputs_of_schema, normalise_schema_name
from cwcli.text import format_count

if TYPE_CHECKING:
    from cwcli.logs.codecs.ros2msg import MessageField

OTHER_USES_OF_SCHEMAS = {
    "tf2_msgs/TFMessage": "transforms: give the mounting of sensors",
    "foxglove.FrameTransform": "transforms: give the mounting of sensors",
    "foxglove.FrameTransforms": "transforms: give the mounting of sensors",
    "diagnostic_msgs/DiagnosticArray": "`cwcli evaluate --topic warning=` judges what a system warned of",
}
"""Schema that no role takes -> what cwcli uses it for."""
AMBIGUOUS_TYPES = frozenset(
    {"std_msgs/Float32", "std_msgs/Float64", "geometry_msgs/Twist", "geometry_msgs/TwistWithCovariance"}
)
"""Types that fill a role only where the user names them, because they may hold anything."""
UNKNOWN_TYPE_TEXT = "no role takes this type"
"""Reason given for a type that no role takes."""
MAX_NUMERIC_FIELDS = 2000
"""Fields of a message at which the search for numbers stops; chosen by hand."""
MAX_NESTING = 8
"""Nesting of a message at which the search for numbers stops; chosen by hand."""
MAX_SUGGESTIONS = 2
"""Options suggested for one channel; chosen by hand."""
MAX_SIGNALS_SHOWN = 8
"""Greatest number of CAN signals that a reason lists; a DBC file may describe thousands."""
_SPEED_UNIT_OF_WORD = {"kmh": "kmh", "kph": "kmh", "kmph": "kmh", "mph": "mph", "knots": "knots"}
"""Word in a name -> unit of speed, as `--map` spells it."""
_UNIT_OF_WORD = _SPEED_UNIT_OF_WORD | {"deg": "deg", "degrees": "deg"}
"""Word in a name -> unit, as `--map` spells it."""
_SPEED_WORDS = frozenset({"speed", "velocity", "vel", "vx"})
"""Words that mean a speed."""
_STEERING_WORDS = frozenset({"steer", "steering"})
"""Words that mean a steering angle."""
_COMPASS_WORDS = frozenset({"heading", "azimuth", "course", "cog"})
"""Words that mean an angle from north, clockwise."""
_WORDS_OF_NO_MEASUREMENT = frozenset(
    {
        *("limit", "max", "min", "target", "desired", "cmd", "command", "commanded", "set", "setpoint", "reference"),
        *("rate", "angular", "engine", "wind", "fan", "rpm", "torque", "sigma", "std", "stdev", "covariance"),
        *("variance", "error", "accuracy", "acc", "status", "valid", "mode", "type", "y", "z", "up", "down", "climb"),
    }
)
"""Words of fields that are no measured speed or angle: limits, commands, rates, errors, flags, other axes."""


class ChannelWithDefinition(ChannelLike, Protocol):
    """A channel with its definition."""

    @property
    def message_count(self) -> int | None: ...
    @property
    def schema_encoding(self) -> str: ...
    @property
    def schema_data(self) -> bytes: ...


class UnboundReason(NamedTuple):
    """Why a channel fills no role.

    Attributes:
        why: The reason in words.
        tries: Options that would give it a role, the likeliest first.
    """

    why: str
    tries: tuple[str, ...] = ()


EGO_STATION_OPTION = "--ego-station ID"
"""The suggestion to name the ego's station; its ID is known only to who reads messages."""


def unbound_reasons_by_topic(channels: Sequence[ChannelWithDefinition], bindings: Bindings) -> dict[str, UnboundReason]:
    """Explain for each channel without a role why it has none, by topic.

    Args:
        channels: All channels of the log.
        bindings: The bindings of every role.
    """
    used = {each.topic for bound in bindings.by_role.values() for one in bound for each in (one, *one.parts)}
    return {each.topic: _explain_unbound_channel(each, bindings) for each in channels if each.topic not in used}


def _explain_unbound_channel(channel: ChannelWithDefinition, bindings: Bindings) -> UnboundReason:
    if channel.topic.startswith(OWN_TOPIC_PREFIX):
        return UnboundReason("a result of cwcli that no later stage reads")
    if channel.message_count == 0:
        return UnboundReason("it has no messages")
    name = normalise_schema_name(channel.schema_name)
    if not inputs_of_schema(channel.schema_name):
        return _explain_unknown_type(channel, name)
    if name in AMBIGUOUS_TYPES:
        return _explain_ambiguous_type(channel.topic, name)
    texts, tries = [], []
    for entry in inputs_of_schema(channel.schema_name):
        role, others = str(entry.role), bindings.channels_of_role(entry.role)
        if role in bindings.undecided:
            topics = ",".join(each.topic for each in bindings.undecided[role])
            texts.append(f"one of several candidates for {role}")
            tries.append(f"--topic {role}={channel.topic}")
            if entry.role in ROLES_WITH_MANY_TOPICS:
                tries.append(f"--topic {role}={topics}")
        elif is_truth_topic(channel.topic) and role not in TRUTH_ROLES:
            continue
        elif others:
            texts.append(f"{role} is taken from {', '.join(each.topic for each in others)}")
        elif entry.needs_ego_station:
            texts.append(f"{role}, if you name the ego's station")
            tries.append(EGO_STATION_OPTION)
        else:
            texts.append(f"{role}, only if you name it")
            tries.append(f"--topic {role}={channel.topic}")
    why = "; ".join(dict.fromkeys(texts)) or "its topic's name marks it as truth, and no truth has this type"
    return UnboundReason(why, tuple(dict.fromkeys(tries))[:MAX_SUGGESTIONS])


def _explain_ambiguous_type(topic: str, name: str) -> UnboundReason:
    """Explain an ambiguous type by the words in its topic's name."""
    words = _split_into_words(topic)
    if not set(words) & (_SPEED_WORDS | set(_SPEED_UNIT_OF_WORD)) or set(words) & _WORDS_OF_NO_MEASUREMENT:
        return UnboundReason("neither the type nor the topic's name says what it measures")
    unit = next((_SPEED_UNIT_OF_WORD[word] for word in words if word in _SPEED_UNIT_OF_WORD), "")
    line = f"--map ego_speed={topic}:data*{unit}" if unit and "Float" in name else f"--topic ego_speed={topic}"
    return UnboundReason("ego_speed (m/s), only if you name it", (line,))


def _explain_unknown_type(channel: ChannelWithDefinition, name: str) -> UnboundReason:
    if name in CAN_FRAME_SCHEMAS:
        return UnboundReason(
            "CAN frames need a DBC file", (f"--map ego_speed={channel.topic}:MESSAGE.SIGNAL --dbc FILE",)
        )
    if name in OTHER_USES_OF_SCHEMAS:
        return UnboundReason(OTHER_USES_OF_SCHEMAS[name])
    return UnboundReason(
        UNKNOWN_TYPE_TEXT, suggest_map_options(channel.topic, list(iter_numeric_field_paths(channel)))[:MAX_SUGGESTIONS]
    )


def iter_numeric_field_paths(channel: ChannelWithDefinition) -> Iterator[str]:
    """Yield the paths of the numeric fields of a ROS message; nothing for other encodings."""
    if channel.schema_encoding != "ros2msg":
        return
    from cwcli.logs.codecs.ros2msg import SchemaError, find_message_fields, parse_message_definitions

    try:
        top, definitions = parse_message_definitions(
            channel.schema_name, channel.schema_data.decode("utf-8", "replace")
        )
    except SchemaError:
        return
    count = 0

    def iter_paths(name: str, path: str, depth: int) -> Iterator[str]:
        nonlocal count
        for field in find_message_fields(definitions, name):
            here = f"{path}{field.name}" + ("[0]" if field.is_sequence or field.length else "")
            if _is_number_field(field):
                count += 1
                yield here
            elif "/" in field.type and depth < MAX_NESTING and count < MAX_NUMERIC_FIELDS and not here.endswith("]"):
                yield from iter_paths(field.type, f"{here}.", depth + 1)

    try:
        yield from iter_paths(top, "", 0)
    except SchemaError:
        return


def explain_can_frames(topic: str, signals: Sequence[str], files: Sequence[str]) -> UnboundReason:
    """Why a channel of CAN frames fills no role where DBC files are given, with the `--map` lines to try.

    Args:
        topic: The channel's topic.
        signals: The signals of the files, as `MESSAGE.SIGNAL`.
        files: The DBC files, as the user named them.
    """
    found = suggest_map_options(topic, signals, has_units=True)[:MAX_SUGGESTIONS]
    of_files = "".join(f" --dbc {shlex.quote(file)}" for file in files)
    known = f"CAN frames; {', '.join(files)} describes {format_count(len(signals), 'signal')}"
    if found:
        return UnboundReason(f"{known}: name the one that a role takes", tuple(f"{line}{of_files}" for line in found))
    shown = ", ".join(signals[:MAX_SIGNALS_SHOWN])
    return UnboundReason(f"{known}, none with the name of a speed, heading or steering angle: {shown}")


def suggest_map_options(topic: str, paths: Sequence[str], *, has_units: bool = False) -> tuple[str, ...]:
    """Suggest `--map` options for a message with these numeric fields, the likeliest first.

    Args:
        topic: Topic of the channel.
        paths: Paths of its leaf fields.
        has_units: Whether units come with the fields, so that none is guessed from a name.
    """
    found: list[tuple[int, str]] = []
    by_parent: dict[str, dict[str, str]] = {}
    for path in paths:
        parent, _, leaf = path.rpartition(".")
        words = set(_split_into_words(leaf))
        place = {"lat": "lat", "latitude": "lat", "lon": "lon", "lng": "lon", "longitude": "lon"}.get(leaf.lower())
        if place:
            by_parent.setdefault(parent, {})[place] = path
        if words & _WORDS_OF_NO_MEASUREMENT or "stamp" in path:
            continue
        unit = (
            ""
            if has_units
            else next((f"*{_UNIT_OF_WORD[word]}" for word in _split_into_words(path) if word in _UNIT_OF_WORD), "")
        )
        if (
            words & (_SPEED_WORDS | set(_SPEED_UNIT_OF_WORD))
            and not set(_split_into_words(path)) & _WORDS_OF_NO_MEASUREMENT
        ):
            found.append((1 + 10 * ("[" in leaf), f"--map ego_speed={topic}:{path}{unit if unit != '*deg' else ''}"))
        elif words & _STEERING_WORDS or ("angle" in words and "steer" in path.lower()):
            found.append((2, f"--map ego_steer={topic}:{path}{unit if unit == '*deg' else ''}"))
        elif words & _COMPASS_WORDS:
            found.append((3, f"--map ego_heading={topic}:-{path}{'' if has_units else '*deg'}+90deg"))
        elif "yaw" in words:
            found.append((3, f"--map ego_heading={topic}:{path}{unit if unit == '*deg' else ''}"))
    for both in by_parent.values():
        if len(both) == len(("lat", "lon")):
            found.append((0, f"--map ego_position={topic}:{both['lat']},{both['lon']}"))
    return tuple(text for _, text in sorted(found, key=lambda each: each[0]))


def _is_number_field(field: MessageField) -> bool:
    return field.type.startswith(("float", "int", "uint"))


def _split_into_words(name: str) -> list[str]:
    """Split a name into lower-case words: `vehicleSpeed_kmh` gives vehicle, speed, kmh."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return [word for word in re.split(r"[^a-z]+", spaced.lower()) if word]
