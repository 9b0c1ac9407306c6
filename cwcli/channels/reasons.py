"""Explains from topics, schemas and field names why a channel fills no role, and suggests options; reads no message."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

from cwcli.channels.binding import MANY_TOPICS, TRUTH_ROLES, Bindings, ChannelLike, is_truth_topic
from cwcli.channels.published import OWN_PREFIX
from cwcli.signals.input_rows import CAN_SCHEMAS
from cwcli.signals.inputs import inputs_of, normalise
from cwcli.text import count as format_count

if TYPE_CHECKING:
    from cwcli.logs.codecs.ros2msg import MessageField

OTHER_USES = {
    "tf2_msgs/TFMessage": "transforms: give the mounting of sensors",
    "foxglove.FrameTransform": "transforms: give the mounting of sensors",
    "foxglove.FrameTransforms": "transforms: give the mounting of sensors",
    "diagnostic_msgs/DiagnosticArray": "`cwcli evaluate --topic warning=` judges what a system warned of",
}
"""Schema that no role takes -> what cwcli uses it for."""
UNNAMED = frozenset(
    {"std_msgs/Float32", "std_msgs/Float64", "geometry_msgs/Twist", "geometry_msgs/TwistWithCovariance"}
)
"""Types that fill a role only where the user names them, because they may hold anything."""
UNKNOWN_TYPE = "no role takes this type"
"""Reason given for a type that no role takes."""
MAX_LEAVES = 2000
"""Fields of a message at which the search for numbers stops; chosen by hand."""
MAX_DEPTH = 8
"""Nesting of a message at which the search for numbers stops; chosen by hand."""
MAX_TRIES = 2
"""Options suggested for one channel; chosen by hand."""
MAX_SIGNALS_SHOWN = 8
"""Greatest number of CAN signals that a reason lists; a DBC file may describe thousands."""
_SPEED_UNITS = {"kmh": "kmh", "kph": "kmh", "kmph": "kmh", "mph": "mph", "knots": "knots"}
"""Word in a name -> unit of speed, as `--map` spells it."""
_UNITS = _SPEED_UNITS | {"deg": "deg", "degrees": "deg"}
"""Word in a name -> unit, as `--map` spells it."""
_SPEED = frozenset({"speed", "velocity", "vel", "vx"})
"""Words that mean a speed."""
_STEER = frozenset({"steer", "steering"})
"""Words that mean a steering angle."""
_COMPASS = frozenset({"heading", "azimuth", "course", "cog"})
"""Words that mean an angle from north, clockwise."""
_NO_MEASUREMENT = frozenset(
    {
        *("limit", "max", "min", "target", "desired", "cmd", "command", "commanded", "set", "setpoint", "reference"),
        *("rate", "angular", "engine", "wind", "fan", "rpm", "torque", "sigma", "std", "stdev", "covariance"),
        *("variance", "error", "accuracy", "acc", "status", "valid", "mode", "type", "y", "z", "up", "down", "climb"),
    }
)
"""Words of fields that are no measured speed or angle: limits, commands, rates, errors, flags, other axes."""


class Described(ChannelLike, Protocol):
    """A channel with its definition."""

    @property
    def message_count(self) -> int | None: ...
    @property
    def schema_encoding(self) -> str: ...
    @property
    def schema_data(self) -> bytes: ...


class Reason(NamedTuple):
    """Why a channel fills no role.

    Attributes:
        why: The reason in words.
        tries: Options that would give it a role, the likeliest first.
    """

    why: str
    tries: tuple[str, ...] = ()


def reasons(channels: Sequence[Described], bindings: Bindings) -> dict[str, Reason]:
    """Explain for each channel without a role why it has none, by topic.

    Args:
        channels: All channels of the log.
        bindings: The bindings of every role.
    """
    used = {each.topic for bound in bindings.by_role.values() for one in bound for each in (one, *one.parts)}
    return {each.topic: _reason(each, bindings) for each in channels if each.topic not in used}


def _reason(channel: Described, bindings: Bindings) -> Reason:
    if channel.topic.startswith(OWN_PREFIX):
        return Reason("a result of cwcli that no later stage reads")
    if channel.message_count == 0:
        return Reason("it has no messages")
    name = normalise(channel.schema_name)
    if not inputs_of(channel.schema_name):
        return _unknown(channel, name)
    if name in UNNAMED:
        return _unnamed(channel.topic, name)
    texts, tries = [], []
    for entry in inputs_of(channel.schema_name):
        role, others = str(entry.role), bindings.of(entry.role)
        if role in bindings.undecided:
            topics = ",".join(each.topic for each in bindings.undecided[role])
            texts.append(f"one of several candidates for {role}")
            tries.append(f"--topic {role}={channel.topic}")
            if entry.role in MANY_TOPICS:
                tries.append(f"--topic {role}={topics}")
        elif is_truth_topic(channel.topic) and role not in TRUTH_ROLES:
            continue
        elif others:
            texts.append(f"{role} is taken from {', '.join(each.topic for each in others)}")
        elif entry.needs_ego_station:
            texts.append(f"{role}, if you name the ego's station")
            tries.append("--ego-station ID")
        else:
            texts.append(f"{role}, only if you name it")
            tries.append(f"--topic {role}={channel.topic}")
    why = "; ".join(dict.fromkeys(texts)) or "its topic's name marks it as truth, and no truth has this type"
    return Reason(why, tuple(dict.fromkeys(tries))[:MAX_TRIES])


def _unnamed(topic: str, name: str) -> Reason:
    """Explain an ambiguous type by the words in its topic's name."""
    words = _words(topic)
    if not set(words) & (_SPEED | set(_SPEED_UNITS)) or set(words) & _NO_MEASUREMENT:
        return Reason("neither the type nor the topic's name says what it measures")
    unit = next((_SPEED_UNITS[word] for word in words if word in _SPEED_UNITS), "")
    line = f"--map ego_speed={topic}:data*{unit}" if unit and "Float" in name else f"--topic ego_speed={topic}"
    return Reason("ego_speed (m/s), only if you name it", (line,))


def _unknown(channel: Described, name: str) -> Reason:
    if name in CAN_SCHEMAS:
        return Reason("CAN frames need a DBC file", (f"--map ego_speed={channel.topic}:MESSAGE.SIGNAL --dbc FILE",))
    if name in OTHER_USES:
        return Reason(OTHER_USES[name])
    return Reason(UNKNOWN_TYPE, suggestions(channel.topic, list(leaves(channel)))[:MAX_TRIES])


def leaves(channel: Described) -> Iterator[str]:
    """Yield the paths of the numeric fields of a ROS message; nothing for other encodings."""
    if channel.schema_encoding != "ros2msg":
        return
    from cwcli.logs.codecs.ros2msg import SchemaError, find_definition, parse_definitions

    try:
        top, definitions = parse_definitions(channel.schema_name, channel.schema_data.decode("utf-8", "replace"))
    except SchemaError:
        return
    count = 0

    def iter_paths(name: str, path: str, depth: int) -> Iterator[str]:
        nonlocal count
        for field in find_definition(definitions, name):
            here = f"{path}{field.name}" + ("[0]" if field.is_sequence or field.length else "")
            if _is_number(field):
                count += 1
                yield here
            elif "/" in field.type and depth < MAX_DEPTH and count < MAX_LEAVES and not here.endswith("]"):
                yield from iter_paths(field.type, f"{here}.", depth + 1)

    try:
        yield from iter_paths(top, "", 0)
    except SchemaError:
        return


def explain_can_frames(topic: str, signals: Sequence[str], files: Sequence[str]) -> Reason:
    """Why a channel of CAN frames fills no role where DBC files are given, with the `--map` lines to try.

    Args:
        topic: The channel's topic.
        signals: The signals of the files, as `MESSAGE.SIGNAL`.
        files: The DBC files, as the user named them.
    """
    found = suggestions(topic, signals, has_units=True)[:MAX_TRIES]
    of_files = "".join(f" --dbc {shlex.quote(file)}" for file in files)
    known = f"CAN frames; {', '.join(files)} describes {format_count(len(signals), 'signal')}"
    if found:
        return Reason(f"{known}: name the one that a role takes", tuple(f"{line}{of_files}" for line in found))
    shown = ", ".join(signals[:MAX_SIGNALS_SHOWN])
    return Reason(f"{known}, none with the name of a speed, heading or steering angle: {shown}")


def suggestions(topic: str, paths: Sequence[str], *, has_units: bool = False) -> tuple[str, ...]:
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
        words = set(_words(leaf))
        place = {"lat": "lat", "latitude": "lat", "lon": "lon", "lng": "lon", "longitude": "lon"}.get(leaf.lower())
        if place:
            by_parent.setdefault(parent, {})[place] = path
        if words & _NO_MEASUREMENT or "stamp" in path:
            continue
        unit = "" if has_units else next((f"*{_UNITS[word]}" for word in _words(path) if word in _UNITS), "")
        if words & (_SPEED | set(_SPEED_UNITS)) and not set(_words(path)) & _NO_MEASUREMENT:
            found.append((1 + 10 * ("[" in leaf), f"--map ego_speed={topic}:{path}{unit if unit != '*deg' else ''}"))
        elif words & _STEER or ("angle" in words and "steer" in path.lower()):
            found.append((2, f"--map ego_steer={topic}:{path}{unit if unit == '*deg' else ''}"))
        elif words & _COMPASS:
            found.append((3, f"--map ego_heading={topic}:-{path}{'' if has_units else '*deg'}+90deg"))
        elif "yaw" in words:
            found.append((3, f"--map ego_heading={topic}:{path}{unit if unit == '*deg' else ''}"))
    for both in by_parent.values():
        if len(both) == len(("lat", "lon")):
            found.append((0, f"--map ego_position={topic}:{both['lat']},{both['lon']}"))
    return tuple(text for _, text in sorted(found, key=lambda each: each[0]))


def _is_number(field: MessageField) -> bool:
    return field.type.startswith(("float", "int", "uint"))


def _words(name: str) -> list[str]:
    """Split a name into lower-case words: `vehicleSpeed_kmh` gives vehicle, speed, kmh."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return [word for word in re.split(r"[^a-z]+", spaced.lower()) if word]
