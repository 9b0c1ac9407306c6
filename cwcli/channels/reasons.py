"""Why a channel fills no role, and what to try: told from topics, schemas and the names of fields; nothing is read."""

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
    "tf2_msgs/TFMessage": "transforms: tell where sensors stand",
    "foxglove.FrameTransform": "transforms: tell where sensors stand",
    "foxglove.FrameTransforms": "transforms: tell where sensors stand",
    "diagnostic_msgs/DiagnosticArray": "`cwcli evaluate --topic warning=` judges what a system warned of",
}
"""Schemas that no role takes, and who reads them."""
UNNAMED = frozenset(
    {"std_msgs/Float32", "std_msgs/Float64", "geometry_msgs/Twist", "geometry_msgs/TwistWithCovariance"}
)
"""Types that fill a role where the user says so, of which many channels hold something else."""
UNKNOWN_TYPE = "no role takes this type"
MAX_LEAVES = 2000
MAX_DEPTH = 8
MAX_TRIES = 2
MAX_SIGNALS_SHOWN = 8
"""Greatest number of CAN signals that a reason lists; a DBC file may describe thousands."""
_SPEED_UNITS = {"kmh": "kmh", "kph": "kmh", "kmph": "kmh", "mph": "mph", "knots": "knots"}
_UNITS = _SPEED_UNITS | {"deg": "deg", "degrees": "deg"}
_SPEED = frozenset({"speed", "velocity", "vel", "vx"})
_STEER = frozenset({"steer", "steering"})
_COMPASS = frozenset({"heading", "azimuth", "course", "cog"})
_NO_MEASUREMENT = frozenset(
    {
        *("limit", "max", "min", "target", "desired", "cmd", "command", "commanded", "set", "setpoint", "reference"),
        *("rate", "angular", "engine", "wind", "fan", "rpm", "torque", "sigma", "std", "stdev", "covariance"),
        *("variance", "error", "accuracy", "acc", "status", "valid", "mode", "type", "y", "z", "up", "down", "climb"),
    }
)


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
        why: In words.
        tries: Options that would change it, the likeliest first.
    """

    why: str
    tries: tuple[str, ...] = ()


def reasons(channels: Sequence[Described], bindings: Bindings) -> dict[str, Reason]:
    """Topic -> why it fills no role, for those that fill none.

    Args:
        channels: Of the log.
        bindings: Of every role.
    """
    used = {each.topic for bound in bindings.by_role.values() for one in bound for each in (one, *one.parts)}
    return {each.topic: _reason(each, bindings) for each in channels if each.topic not in used}


def _reason(channel: Described, bindings: Bindings) -> Reason:
    if channel.topic.startswith(OWN_PREFIX):
        return Reason("a result of cwcli that later stages do not start from")
    if channel.message_count == 0:
        return Reason("it has no message")
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
            texts.append(f"one of several for {role}")
            tries.append(f"--topic {role}={channel.topic}")
            if entry.role in MANY_TOPICS:
                tries.append(f"--topic {role}={topics}")
        elif is_truth_topic(channel.topic) and role not in TRUTH_ROLES:
            continue
        elif others:
            texts.append(f"{role} is taken from {', '.join(each.topic for each in others)}")
        elif entry.needs_ego_station:
            texts.append(f"{role}, if a station is the ego")
            tries.append("--ego-station ID")
        else:
            texts.append(f"{role} only where it is named")
            tries.append(f"--topic {role}={channel.topic}")
    why = "; ".join(dict.fromkeys(texts)) or "its topic's name says truth, and this type holds none"
    return Reason(why, tuple(dict.fromkeys(tries))[:MAX_TRIES])


def _unnamed(topic: str, name: str) -> Reason:
    """Of a message that does not say what it is: what its topic's name says."""
    words = _words(topic)
    if not set(words) & (_SPEED | set(_SPEED_UNITS)) or set(words) & _NO_MEASUREMENT:
        return Reason("neither the type nor the topic's name says what it measures")
    unit = next((_SPEED_UNITS[word] for word in words if word in _SPEED_UNITS), "")
    line = f"--map ego_speed={topic}:data*{unit}" if unit and "Float" in name else f"--topic ego_speed={topic}"
    return Reason("ego_speed (m/s) only where it is named", (line,))


def _unknown(channel: Described, name: str) -> Reason:
    if name in CAN_SCHEMAS:
        return Reason("CAN frames need a DBC file", (f"--map ego_speed={channel.topic}:MESSAGE.SIGNAL --dbc FILE",))
    if name in OTHER_USES:
        return Reason(OTHER_USES[name])
    return Reason(UNKNOWN_TYPE, suggestions(channel.topic, list(leaves(channel)))[:MAX_TRIES])


def leaves(channel: Described) -> Iterator[str]:
    """The paths of the numbers in a ROS message, () for a channel of another encoding."""
    if channel.schema_encoding != "ros2msg":
        return
    from cwcli.logs.codecs.ros2msg import SchemaError, find_definition, parse_definitions

    try:
        top, definitions = parse_definitions(channel.schema_name, channel.schema_data.decode("utf-8", "replace"))
    except SchemaError:
        return
    count = 0

    def walk(name: str, path: str, depth: int) -> Iterator[str]:
        nonlocal count
        for field in find_definition(definitions, name):
            here = f"{path}{field.name}" + ("[0]" if field.is_sequence or field.length else "")
            if _is_number(field):
                count += 1
                yield here
            elif "/" in field.type and depth < MAX_DEPTH and count < MAX_LEAVES and not here.endswith("]"):
                yield from walk(field.type, f"{here}.", depth + 1)

    try:
        yield from walk(top, "", 0)
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
    """The `--map` lines to try for a message with these numbers, the likeliest first.

    Args:
        topic: Of the channel.
        paths: Its leaf fields.
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
    """`vehicleSpeed_kmh` -> vehicle, speed, kmh."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    return [word for word in re.split(r"[^a-z]+", spaced.lower()) if word]
