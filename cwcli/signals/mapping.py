"""A user's own mapping: which fields of a topic hold a quantity, and in which unit. It is parsed, never evaluated.

    ego_speed=/vehicle/status:wheel.kmh*0.2778
    ego_heading=/compass:-yaw*deg+90deg
    ego_position=/gps:lat*1e-7,lon*1e-7@time_us*us
    ego_speed=/can/frames:WHEELS.Speed*kmh;car.dbc

    ego_position=/lat:data|/lon:data

Behind the colon stand the quantities of the role in order: each a field, with a sign before it, factors or units behind
it, and an offset in the unit of the role. Behind @ stands the field of the time, behind ; a file that describes CAN
messages. Behind | stands the next mapping of the same role: of the quantities that the one before lacks, or leaves out
(`ego_speed=/speed:data|/gyro:,z`), else of another source.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.role import Role
from cwcli.signals.stamp_fields import HEADER_STAMP_FIELDS, JSON_STAMP_FIELDS, PROTOBUF_STAMP_FIELDS
from cwcli.signals.units import MPS_PER_KMH, STANDARD_GRAVITY_MPS2

SI_FACTORS_BY_UNIT_BY_KIND: dict[str, dict[str, float]] = {
    "speed": {"mps": 1.0, "kmh": MPS_PER_KMH, "mph": 0.44704, "knots": 1852.0 / 3600.0, "mmps": 1e-3, "cmps": 1e-2},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 1e-3},
    "turn rate": {"radps": 1.0, "degps": math.pi / 180.0},
    "acceleration": {"mps2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": 1e-3 * STANDARD_GRAVITY_MPS2},
    "place": {"deg": 1.0, "rad": 180.0 / math.pi},
    "height": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "ft": 0.3048},
}
"""The factor of each unit to cwcli's unit (m/s, rad, rad/s, m/s^2, degrees, m), by kind of quantity."""
UNIT_IN_ROS_MESSAGES_BY_KIND_OF_QUANTITY = {
    "speed": "m/s",
    "angle": "rad",
    "turn rate": "rad/s",
    "acceleration": "m/s^2",
    "place": "deg",
    "height": "m",
}
"""The unit in which messages give each kind of quantity (ROS REP 103 and `sensor_msgs/NavSatFix`)."""
MAPPING_SEPARATOR = "|"
"""The character between two mappings of a role."""
NS_PER_TIME_UNIT = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0}
"""The nanoseconds of each unit of time."""


@dataclass(frozen=True)
class MappedQuantities:
    """The message and the quantities that a mapping of a role gives.

    Attributes:
        schema: The message that the mapped channel is converted to.
        fields: The kind of quantity of each of its fields, in order.
        n_needed: The least number of them.
    """

    schema: str
    fields: dict[str, str]
    n_needed: int = 1


MAPPED_QUANTITIES_BY_ROLE: dict[str, MappedQuantities] = {
    Role.EGO_POSITION: MappedQuantities(
        "sensor_msgs/NavSatFix", {"latitude": "place", "longitude": "place", "altitude": "height"}, 2
    ),
    Role.EGO_VELOCITY: MappedQuantities(
        "geometry_msgs/TwistStamped", {"twist.linear.x": "speed", "twist.linear.y": "speed"}, 2
    ),
    Role.EGO_SPEED: MappedQuantities(
        "autoware_vehicle_msgs/VelocityReport", {"longitudinal_velocity": "speed", "heading_rate": "turn rate"}
    ),
    Role.EGO_HEADING: MappedQuantities("geometry_msgs/QuaternionStamped", {"yaw": "angle"}),
    Role.EGO_STEER: MappedQuantities("autoware_vehicle_msgs/SteeringReport", {"steering_tire_angle": "angle"}),
    Role.IMU: MappedQuantities(
        "sensor_msgs/Imu",
        {f"linear_acceleration.{axis}": "acceleration" for axis in "xyz"}
        | {f"angular_velocity.{axis}": "turn rate" for axis in "xyz"},
        6,
    ),
}
"""The quantities that can be mapped, by role."""
_NUMBER_PATTERN = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
"""The pattern of a number without a sign."""
_NAME_PATTERN = r"[A-Za-z_]\w*"
"""The pattern of a field's name."""
_PATH_PATTERN = rf"{_NAME_PATTERN}(?:\.{_NAME_PATTERN})*"
"""The pattern of a dotted path."""
# compiled when they are first used: binding imports this at every start
_TERM_PATTERN = (
    rf"(?P<sign>-?)(?P<path>{_PATH_PATTERN})(?:\[(?P<index>\d{{1,4}})\])?(?P<scales>(?:[*/](?:{_NUMBER_PATTERN}|{_NAME_PATTERN}))*)"
    rf"(?P<offset>[+-]{_NUMBER_PATTERN})?(?P<unit>(?<=[\d.]){_NAME_PATTERN})?"
)
"""The pattern of one quantity: sign, path, index, scales, offset and unit."""
_STAMP_PATTERN = rf"(?P<path>{_PATH_PATTERN})(?:\*(?P<unit>s|ms|us|ns))?"
"""The pattern of the time's field and its unit."""
_SCALE_PATTERN = rf"([*/])({_NUMBER_PATTERN}|{_NAME_PATTERN})"
"""The pattern of one scale: a sign, and a number or unit."""
_USUAL_STAMP_FIELDS = (*HEADER_STAMP_FIELDS, *PROTOBUF_STAMP_FIELDS, *JSON_STAMP_FIELDS)
"""The leaf fields of a message's usual time."""


@dataclass(frozen=True)
class Term:
    """One quantity: `factor * field + offset`.

    Attributes:
        path: The field, or message and signal of a CAN frame.
        index: The index in a sequence, or None.
        factor, offset: The scale and offset to the role's unit.
        has_scale: The user gave a unit or a factor.
    """

    path: str
    index: int | None
    factor: float
    offset: float
    has_scale: bool


@dataclass(frozen=True)
class FieldMapping:
    """A parsed mapping.

    Attributes:
        role, topic: The role and the channel.
        terms: The role's quantities, in order.
        stamp, stamp_unit_ns: The field of the time ("" for the header's) and its unit; a field with `sec` and `nanosec`
            below needs none.
        files: The DBC files that describe the messages of a CAN bus.
        text: The text behind the role, as it was given.
        first: The index of its first term among the role's quantities.
        parts: The mappings of further channels that give the quantities behind its own.
    """

    role: str
    topic: str
    terms: tuple[Term, ...]
    stamp: str
    stamp_unit_ns: float
    files: tuple[str, ...]
    text: str
    first: int = 0
    parts: tuple[FieldMapping, ...] = ()

    @property
    def target_field_names(self) -> tuple[str, ...]:
        """Return the fields of the message that the terms become."""
        return tuple(MAPPED_QUANTITIES_BY_ROLE[self.role].fields)[self.first : self.first + len(self.terms)]

    @property
    def n_given_quantities(self) -> int:
        """Return how many of the role's quantities the mapping and its parts give."""
        return len(self.terms) + sum(len(part.terms) for part in self.parts)

    @property
    def leaf_fields_to_load(self) -> tuple[str, ...]:
        """Return the leaf fields to load."""
        times = ("sec", "nanosec", "secs", "nsecs", "nsec")
        own = (self.stamp, *(f"{self.stamp}.{name}" for name in times)) if self.stamp else _USUAL_STAMP_FIELDS
        return (*own, *(term.path for term in self.terms))


def merge_mapping_options(options: Sequence[str], files: Sequence[str], name_of_option: str = "--map") -> list[str]:
    """Return the `ROLE=/topic:field` of each role, followed by the files that describe CAN messages.

    Several options of one role become one, with a | between them.

    Raises:
        UsageError: An option names no field, or a role whose fields can't be mapped.
    """
    texts: dict[str, list[str]] = {}
    for option in options:
        role, separator, text = option.partition("=")
        if not separator or not is_field_mapping(text):
            raise UsageError(
                f"{name_of_option} {option}: expected ROLE=/topic:field",
                hint=f"roles: {', '.join(MAPPED_QUANTITIES_BY_ROLE)}",
            )
        texts.setdefault(role, []).extend(";".join((one.strip(), *files)) for one in text.split(MAPPING_SEPARATOR))
    text_by_role = {role: MAPPING_SEPARATOR.join(each) for role, each in texts.items()}
    for role, text in text_by_role.items():
        parse_field_mappings(role, text)
    return [f"{role}={text}" for role, text in text_by_role.items()]


def is_field_mapping(text: str) -> bool:
    """Return whether the text behind a role names fields as well."""
    return ":" in text


def parse_field_mappings(role: str, text: str) -> tuple[FieldMapping, ...]:
    """Parse the text behind a role's `=`: each source, with its parts.

    Raises:
        UsageError: It is malformed, has too few or too many quantities, or a unit that does not measure them.
    """
    quantities = MAPPED_QUANTITIES_BY_ROLE.get(role)
    if quantities is None:
        raise UsageError(
            f"--map {role}: its fields can't be mapped",
            hint=hint_at_closest_or_all_known_names(role, MAPPED_QUANTITIES_BY_ROLE, "roles that can"),
        )
    sources: list[FieldMapping] = []
    for one in text.split(MAPPING_SEPARATOR):
        n_before = sources[-1].n_given_quantities if sources else quantities.n_needed
        n_left_out = len(found.group(1)) if (found := re.search(r":\s*(,+)", one)) else 0
        if n_left_out and (not sources or n_left_out != n_before):
            raise UsageError(
                f"--map {role}={one}: it starts with quantity {n_left_out + 1}",
                hint=f"the {n_left_out} before it must be given in an earlier mapping",
            )
        if n_before < quantities.n_needed or n_left_out:
            part = _parse_channel_mapping(role, one.strip(), quantities, n_before)
            sources[-1] = replace(sources[-1], parts=(*sources[-1].parts, part))
        else:
            sources.append(_parse_channel_mapping(role, one.strip(), quantities, 0))
    for source in sources:
        if source.n_given_quantities < quantities.n_needed:
            field_names = ", ".join(quantities.fields)
            raise UsageError(
                f"--map {role}={source.text}: {source.n_given_quantities} fields for {field_names}",
                hint="separate them by commas, or give --map once more for those of another channel",
            )
    topics = [source.topic for source in sources]
    twice = next((topic for topic in topics if topics.count(topic) > 1), None)
    if twice is not None:
        raise UsageError(f"--map {role}: {twice} is given twice", hint="one mapping of a role for each channel")
    return tuple(sources)


def _parse_channel_mapping(role: str, text: str, quantities: MappedQuantities, first_quantity: int) -> FieldMapping:
    """Parse the mapping of one channel, whose terms are the role's quantities from `first` on."""
    rest, *files = text.split(";")
    topic, _, rest = rest.partition(":")
    said, at, stamp_text = rest.partition("@")
    stamp = re.fullmatch(_STAMP_PATTERN, stamp_text)
    if not topic or (at and not stamp):
        raise _error_about_malformed_mapping(role, text, stamp_text or topic)
    texts, kinds = said.strip().lstrip(",").split(","), tuple(quantities.fields.values())[first_quantity:]
    if len(texts) > len(kinds):
        field_names = ", ".join(tuple(quantities.fields)[first_quantity:])
        raise UsageError(f"--map {role}={text}: {len(texts)} fields for {field_names}", hint="separate them by commas")
    terms = tuple(_parse_term(role, text, part.strip(), kind) for part, kind in zip(texts, kinds, strict=False))
    unit = NS_PER_TIME_UNIT[stamp["unit"]] if stamp and stamp["unit"] else NS_PER_TIME_UNIT["s"]
    return FieldMapping(
        role, topic, terms, stamp["path"] if stamp else "", unit, tuple(filter(None, files)), text, first_quantity
    )


def _parse_term(role: str, text: str, part: str, kind: str) -> Term:
    found = re.fullmatch(_TERM_PATTERN, part)
    if found is None or (found["unit"] and not found["offset"]):
        raise _error_about_malformed_mapping(role, text, part)
    factor = -1.0 if found["sign"] else 1.0
    for sign, word in re.findall(_SCALE_PATTERN, found["scales"]):
        value = _parse_number_or_factor_of_unit(role, text, word, kind)
        if value == 0.0:
            raise _error_about_malformed_mapping(role, text, part)
        factor = factor * value if sign == "*" else factor / value
    offset = float(found["offset"] or 0.0) * (
        _parse_number_or_factor_of_unit(role, text, found["unit"], kind) if found["unit"] else 1.0
    )
    if not (math.isfinite(factor) and math.isfinite(offset)):
        raise _error_about_malformed_mapping(role, text, part)
    index = None if found["index"] is None else int(found["index"])
    return Term(found["path"], index, factor, offset, bool(found["scales"]))


def _parse_number_or_factor_of_unit(role: str, text: str, quantity: str, kind: str) -> float:
    """Return a number, or the factor of a unit of this kind."""
    if quantity[0].isdigit() or quantity[0] == ".":
        return float(quantity)
    if quantity not in SI_FACTORS_BY_UNIT_BY_KIND[kind]:
        known = ", ".join(SI_FACTORS_BY_UNIT_BY_KIND[kind])
        raise UsageError(
            f"--map {role}={text}: {quantity} is not a unit of {kind}", hint=f"units: {known}, or a number"
        )
    return SI_FACTORS_BY_UNIT_BY_KIND[kind][quantity]


def _error_about_malformed_mapping(role: str, text: str, part: str) -> UsageError:
    return UsageError(
        f"--map {role}={text}: {part!r} can't be read",
        hint="for example --map ego_speed=/topic:field.path*0.2778, with -field, /3.6, *kmh, +1.5 or @stamp",
    )
