"""Explains from topics, schemas and field names why a channel fills no role, and suggests options; reads no message."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

from cwcli.channels.binding import ROLES_WITH_MANY_TOPICS, TRUTH_ROLES, Bindings, ChannelLike, is_truth_topic
from cwcli.channels.published import OWN_TOPIC_PREFIX
from cwcli.signals.input_rows import CAN_FRAME_SCHEMAS
from cwcli.signals.inputs import inputs_of_schema, normalise_schema_name
from cwcli.text import format_count

if TYPE_CHECKING:
    from cwcli.logs.codecs.ros2msg import MessageField

USE_BY_ROLELESS_SCHEMA = {
    "tf2_msgs/TFMessage": "transforms: give the mounting of sensors",
    "foxglove.FrameTransform": "transforms: give the mounting of sensors",
    "foxglove.FrameTransforms": "transforms: give the mounting of sensors",
    "diagnostic_msgs/DiagnosticArray": "`cwcli evaluate --topic warning=` judges what a system warned of",
}
"""Schema that no role takes -> what cwcli uses it for."""
SCHEMAS_BOUND_ONLY_IF_NAMED = frozenset(
    {"std_msgs/Float32", "std_msgs/Float64", "geometry_msgs/Twist", "geometry_msgs/TwistWithCovariance"}
)
"""Types that fill a role only where the user names them, because they may hold anything."""
UNKNOWN_TYPE_TEXT = "no role takes this type"
"""Reason given for a type that no role takes."""
FIELDS_NOT_SEARCHED_TEXT = f"{UNKNOWN_TYPE_TEXT}; its fields were not searched, because it would take long"
"""Reason given for the last channels of such types, where all together would take long."""
REASONS_COMPLETED_BY_FIRST_MESSAGES = frozenset(
    {UNKNOWN_TYPE_TEXT, USE_BY_ROLELESS_SCHEMA["diagnostic_msgs/DiagnosticArray"]}
)
"""Reasons that the first messages of a channel may complete: by their fields, or by what they warn of."""
MAX_FIELDS_SEARCHED_FOR_NUMBERS = 2000
"""Greatest number of fields of a message that are searched for numbers. Chosen by hand."""
MAX_FIELDS_SEARCHED_OF_ALL_CHANNELS = 30_000
"""Greatest number of fields of all channels of unknown types together. Chosen by hand: 300 channels of 100."""
FIELDS_AS_COSTLY_AS_THEIR_CHANNEL, SCHEMA_BYTES_AS_COSTLY_AS_ONE_FIELD = 10, 100
"""Fields that take about as long as what a channel takes beside its fields, and bytes of a schema that take as long to
parse as a field to be searched. Chosen by hand."""
MAX_OPTION_CHARS = 300
"""Greatest length of an option's value that is suggested. Chosen by hand."""
MAX_SPLIT_CHARS = 300
"""Length of the end of a name that is split into words, which are kept for the next name. Chosen by hand."""
MAX_NESTING_SEARCHED_FOR_NUMBERS = 8
"""Greatest nesting of a message that is searched for numbers. Chosen by hand."""
MAX_SUGGESTED_OPTIONS_PER_CHANNEL = 2
"""Greatest number of options that are suggested for one channel. Chosen by hand."""
_WARNING_WORDS = frozenset(
    {"fcw", "aeb", "warning", "warnings", "warn", "alert", "alerts", "alarm", "collision", "icw", "eebl", "ldw"}
)
"""Words of topics and fields that tell of another system's warnings."""
_WARNING_RAISED_WORDS = frozenset({"active", "raised", "triggered", "on", "data", "state"})
"""Words of truth values that say whether a warning is on."""
_WARNING_LEVEL_WORDS = frozenset({"level", "severity", "state", "status", "data", "warning", "alert", "stage"})
"""Words of numbers that grow with the urgency of a warning, and are 0 without one."""
FieldKind = Literal["number", "truth value", "text"]
"""The kinds of values that a field of a message can hold."""
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
_WORDS_THAT_RULE_OUT_MEASUREMENT = frozenset(
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
        tries: Options that would give it a role, or a command that judges it, the likeliest first.
        fields: Paths of the fields of its messages, where no role takes the type and they are known.
    """

    why: str
    tries: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()


EGO_STATION_OPTION = "--ego-station ID"
"""The suggestion to name the ego's station; its ID is known only to who reads messages."""


def unbound_reasons_by_topic(channels: Sequence[ChannelWithDefinition], bindings: Bindings) -> dict[str, UnboundReason]:
    """Explain for each channel without a role why it has none, by topic.

    Args:
        channels: All channels of the log.
    """
    used = {each.topic for bound in bindings.by_role.values() for one in bound for each in (one, *one.parts)}
    search = _FieldSearch()
    return {each.topic: _explain_unbound_channel(each, bindings, search) for each in channels if each.topic not in used}


class _FieldSearch:
    """Finds the fields of messages by their definitions, until those of all channels would take long."""

    def __init__(self) -> None:
        self._kinds_by_schema: dict[tuple[str, bytes], dict[str, FieldKind]] = {}
        self._n_left = MAX_FIELDS_SEARCHED_OF_ALL_CHANNELS

    def kinds_or_none(self, channel: ChannelWithDefinition) -> dict[str, FieldKind] | None:
        """Return path -> kind of the fields of a channel, none where they are not known; None at the bound."""
        if channel.schema_encoding != "ros2msg":
            return {}
        if self._n_left <= 0:
            return None
        schema = channel.schema_name, channel.schema_data
        if schema not in self._kinds_by_schema:
            self._n_left -= len(channel.schema_data) // SCHEMA_BYTES_AS_COSTLY_AS_ONE_FIELD
            self._kinds_by_schema[schema] = dict(_iter_field_kinds(channel))
        kinds = self._kinds_by_schema[schema]
        self._n_left -= len(kinds) + FIELDS_AS_COSTLY_AS_THEIR_CHANNEL
        return kinds


def _explain_unbound_channel(channel: ChannelWithDefinition, bindings: Bindings, search: _FieldSearch) -> UnboundReason:
    if channel.topic.startswith(OWN_TOPIC_PREFIX):
        return UnboundReason("a result of cwcli that no later stage reads")
    if channel.message_count == 0:
        return UnboundReason("it has no messages")
    name = normalise_schema_name(channel.schema_name)
    if not inputs_of_schema(channel.schema_name):
        return _explain_unknown_type(channel, name, search)
    if name in SCHEMAS_BOUND_ONLY_IF_NAMED:
        return _explain_ambiguous_type_by_topic_words(channel.topic, name)
    texts: list[str] = []
    tries: list[str] = []
    for entry in inputs_of_schema(channel.schema_name):
        role, others = str(entry.role), bindings.channels_of_role(entry.role)
        if role in bindings.undecided:
            topics = ",".join(each.topic for each in bindings.undecided[role])
            texts.append(f"one of several candidates for {role}")
            tries += format_option_if_printable("--topic", f"{role}={channel.topic}")
            if entry.role in ROLES_WITH_MANY_TOPICS:
                tries += format_option_if_printable("--topic", f"{role}={topics}")
        elif is_truth_topic(channel.topic) and role not in TRUTH_ROLES:
            continue
        elif others:
            texts.append(f"{role} is taken from {', '.join(each.topic for each in others)}")
        elif entry.needs_ego_station:
            texts.append(f"{role}, if you name the ego's station")
            tries.append(EGO_STATION_OPTION)
        else:
            texts.append(f"{role}, only if you name it")
            tries += format_option_if_printable("--topic", f"{role}={channel.topic}")
    why = "; ".join(dict.fromkeys(texts)) or "its topic's name marks it as truth, and no truth has this type"
    return UnboundReason(why, tuple(dict.fromkeys(tries))[:MAX_SUGGESTED_OPTIONS_PER_CHANNEL])


def _explain_ambiguous_type_by_topic_words(topic: str, name: str) -> UnboundReason:
    """Explain an ambiguous type by the words in its topic's name."""
    words = _split_name_into_lower_case_words(topic)
    if not set(words) & (_SPEED_WORDS | set(_SPEED_UNIT_OF_WORD)) or set(words) & _WORDS_THAT_RULE_OUT_MEASUREMENT:
        return UnboundReason("neither the type nor the topic's name says what it measures")
    unit = next((_SPEED_UNIT_OF_WORD[word] for word in words if word in _SPEED_UNIT_OF_WORD), "")
    lines = (
        format_map_option_if_readable("ego_speed", topic, f"data*{unit}")
        if unit and "Float" in name
        else format_option_if_printable("--topic", f"ego_speed={topic}")
    )
    return UnboundReason("ego_speed (m/s), only if you name it", tuple(lines))


def _explain_unknown_type(channel: ChannelWithDefinition, name: str, search: _FieldSearch) -> UnboundReason:
    if name in CAN_FRAME_SCHEMAS:
        return UnboundReason(
            "CAN frames need a DBC file", (f"--map ego_speed={channel.topic}:MESSAGE.SIGNAL --dbc FILE",)
        )
    if name in USE_BY_ROLELESS_SCHEMA:
        return UnboundReason(USE_BY_ROLELESS_SCHEMA[name])
    kinds = search.kinds_or_none(channel)
    if kinds is None:
        return UnboundReason(FIELDS_NOT_SEARCHED_TEXT)
    return explain_unknown_type_by_fields(channel.topic, kinds)


def explain_unknown_type_by_fields(topic: str, kinds: Mapping[str, FieldKind]) -> UnboundReason:
    """Explain a type that no role takes by the fields of its messages, and suggest what to do with them.

    Args:
        kinds: Path of each leaf field -> what it holds; {} where the fields are not known.
    """
    numbers = [path for path, kind in kinds.items() if kind == "number"]
    tries = (*suggest_system_warning_commands(topic, kinds), *suggest_map_options(topic, numbers))
    return UnboundReason(UNKNOWN_TYPE_TEXT, tries[:MAX_SUGGESTED_OPTIONS_PER_CHANNEL], tuple(kinds))


def suggest_system_warning_commands(topic: str, kinds: Mapping[str, FieldKind]) -> tuple[str, ...]:
    """Suggest how `cwcli evaluate` judges a channel as the warnings of another system, if its names tell of warnings.

    Args:
        kinds: Path of each leaf field -> what it holds.
    """
    is_warning_topic = bool(kinds) and bool(_WARNING_WORDS.intersection(_split_name_into_lower_case_words(topic)))
    found: list[tuple[int, str]] = []
    for path, kind in kinds.items():
        words = set(_split_name_into_lower_case_words(path))
        if "stamp" in path or not (is_warning_topic or words & _WARNING_WORDS):
            continue
        if kind == "truth value":
            found.append((0 if words & (_WARNING_WORDS | _WARNING_RAISED_WORDS) else 2, f"{path}==true"))
        elif kind == "number" and words & _WARNING_LEVEL_WORDS:
            found.append((1, f"{path}>=1"))
    best = [condition for _, condition in sorted(found, key=lambda each: each[0])][:1]
    return tuple(line for condition in best for line in format_system_warning_command_if_readable(topic, condition))


def warning_condition_of_diagnostics_or_empty(trees: Sequence[object]) -> str:
    """Return the condition under which a `DiagnosticArray` warns: the level of the status that tells of warnings.

    Args:
        trees: Its first messages, decoded.
    """
    statuses = [status for tree in trees if isinstance(tree, dict) for status in tree.get("status") or ()]
    names = dict.fromkeys(str(status.get("name", "")) for status in statuses if isinstance(status, dict))
    named = next((name for name in names if _WARNING_WORDS.intersection(_split_name_into_lower_case_words(name))), None)
    if named is None:
        return ""
    return f"status[name=='{named}'].level>=1"


def format_system_warning_command_if_readable(topic: str, condition: str) -> list[str]:
    """Format the command that judges another system's warnings; [] where topic or condition can't be typed."""
    from cwcli.errors import UsageError
    from cwcli.signals.field_condition import parse_condition

    try:
        parse_condition(condition)
    except UsageError:
        return []
    command = "cwcli evaluate annotated.mcap --topic"
    return [] if ":" in topic else format_option_if_printable(command, f"warning={topic}:{condition}")


def format_option_if_printable(flag: str, value: str) -> list[str]:
    """Format an option that a shell takes as it stands; [] where nobody could type its value."""
    return [f"{flag} {shlex.quote(value)}"] if value.isprintable() and len(value) <= MAX_OPTION_CHARS else []


def format_map_option_if_readable(role: str, topic: str, fields: str) -> list[str]:
    """Format a `--map` option that a shell takes as it stands; [] where `--map` could not read the names."""
    from cwcli.errors import UsageError
    from cwcli.signals.mapping import parse_field_mappings

    try:
        [mapping] = parse_field_mappings(role, f"{topic}:{fields}")
    except (UsageError, ValueError):
        return []
    return format_option_if_printable("--map", f"{role}={topic}:{fields}") if mapping.topic == topic else []


def _iter_field_kinds(channel: ChannelWithDefinition) -> Iterator[tuple[str, FieldKind]]:
    """Yield path and kind of the leaf fields of a ROS message, texts left out."""
    from cwcli.logs.codecs.ros2msg import SchemaError, find_message_fields, parse_message_definitions

    try:
        top, definitions = parse_message_definitions(
            channel.schema_name, channel.schema_data.decode("utf-8", "replace")
        )
    except SchemaError:
        return
    count = 0

    def iter_paths(name: str, path: str, depth: int) -> Iterator[tuple[str, FieldKind]]:
        nonlocal count
        for field in find_message_fields(definitions, name):
            field_path = f"{path}{field.name}" + ("[0]" if field.is_sequence or field.length else "")
            if _is_numeric_message_field(field) or field.type == "bool":
                count += 1
                yield field_path, "truth value" if field.type == "bool" else "number"
            elif (
                "/" in field.type
                and depth < MAX_NESTING_SEARCHED_FOR_NUMBERS
                and count < MAX_FIELDS_SEARCHED_FOR_NUMBERS
                and not field_path.endswith("]")
            ):
                yield from iter_paths(field.type, f"{field_path}.", depth + 1)

    try:
        yield from iter_paths(top, "", 0)
    except SchemaError:
        return


def explain_can_frames(topic: str, signals: Sequence[str], files: Sequence[str]) -> UnboundReason:
    """Why a channel of CAN frames fills no role where DBC files are given, with the `--map` lines to try.

    Args:
        signals: The signals of the files, as `MESSAGE.SIGNAL`.
        files: The DBC files, as the user named them.
    """
    found = suggest_map_options(topic, signals, has_units=True)[:MAX_SUGGESTED_OPTIONS_PER_CHANNEL]
    of_files = "".join(f" --dbc {shlex.quote(file)}" for file in files)
    known = f"CAN frames; {', '.join(files)} describes {format_count(len(signals), 'signal')}"
    if found:
        tries = tuple(f"{line}{of_files}" for line in found)
        return UnboundReason(f"{known}: name the one that a role takes", tries, tuple(signals))
    why = f"{known}, none with the name of a speed, heading or steering angle"
    return UnboundReason(why, (), tuple(signals))


def suggest_map_options(topic: str, paths: Sequence[str], *, has_units: bool = False) -> tuple[str, ...]:
    """Suggest `--map` options for a message with these numeric fields, the likeliest first.

    Args:
        paths: Paths of its leaf fields.
        has_units: Whether units come with the fields, so that none is guessed from a name.
    """
    found: list[tuple[int, str, str]] = []
    by_parent: dict[str, dict[str, str]] = {}
    for path in paths:
        parent, _, leaf = path.rpartition(".")
        words = set(_split_name_into_lower_case_words(leaf))
        place = {"lat": "lat", "latitude": "lat", "lon": "lon", "lng": "lon", "longitude": "lon"}.get(leaf.lower())
        if place:
            by_parent.setdefault(parent, {})[place] = path
        if words & _WORDS_THAT_RULE_OUT_MEASUREMENT or "stamp" in path:
            continue
        unit = (
            ""
            if has_units
            else next(
                (
                    f"*{_UNIT_OF_WORD[word]}"
                    for word in _split_name_into_lower_case_words(path)
                    if word in _UNIT_OF_WORD
                ),
                "",
            )
        )
        if (
            words & (_SPEED_WORDS | set(_SPEED_UNIT_OF_WORD))
            and not set(_split_name_into_lower_case_words(path)) & _WORDS_THAT_RULE_OUT_MEASUREMENT
        ):
            found.append((1 + 10 * ("[" in leaf), "ego_speed", f"{path}{unit if unit != '*deg' else ''}"))
        elif words & _STEERING_WORDS or ("angle" in words and "steer" in path.lower()):
            found.append((2, "ego_steer", f"{path}{unit if unit == '*deg' else ''}"))
        elif words & _COMPASS_WORDS:
            found.append((3, "ego_heading", f"-{path}{'' if has_units else '*deg'}+90deg"))
        elif "yaw" in words:
            found.append((3, "ego_heading", f"{path}{unit if unit == '*deg' else ''}"))
    for both in by_parent.values():
        if len(both) == len(("lat", "lon")):
            found.append((0, "ego_position", f"{both['lat']},{both['lon']}"))
    ranked = sorted(found, key=lambda each: each[0])
    return tuple(line for _, role, fields in ranked for line in format_map_option_if_readable(role, topic, fields))


def _is_numeric_message_field(field: MessageField) -> bool:
    return field.type.startswith(("float", "int", "uint"))


def _split_name_into_lower_case_words(name: str) -> tuple[str, ...]:
    """Split the end of a name into lower-case words: `vehicleSpeed_kmh` gives vehicle, speed, kmh."""
    return _split_short_name_into_lower_case_words(name[-MAX_SPLIT_CHARS:])


@lru_cache(maxsize=4096)
def _split_short_name_into_lower_case_words(name: str) -> tuple[str, ...]:
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return tuple(word for word in re.split(r"[^a-z]+", spaced.lower()) if word)
