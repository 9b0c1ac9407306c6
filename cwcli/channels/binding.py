"""Binding: which channel of a log fills which role, decided from topics and schemas before anything is read.

The rules:

- a schema of the registry (`inputs.INPUTS_BY_SCHEMA_NAME`) makes a channel a candidate for its roles;
- topics with a segment `truth`, `ground_truth`, `groundtruth` or `gt` are truth only, and only they are; an OSI message
  says itself what it is;
- topics under `/cwcli/` fill only cwcli's own roles, each by its name; where there are no states in hindsight, online
  ones do, with a note;
- of several candidates those of the lowest rank count (a GNSS fix before the ego's own BSM before an odometry);
- two that are left are an error for a required role, and leave an optional one unbound with a note;
  but every channel of detections is a sensor of its own, so all of them are bound;
- messages about other vehicles or events only (CPM, SDSM, DENM) are bound in addition to the chosen channel;
- `--topic ROLE=/topic:FORMAT` names undecoded radio messages and their format, for `remote` and the ego's roles;
- `--topic ROLE=/topic` decides for itself; for `ROLES_WITH_MANY_TOPICS` it may list several, separated by commas, and
  with `ROLE=/topic:field` it names the fields, too (`cwcli.signals.mapping`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Protocol

from cwcli.channels.published import (
    CHANNEL_OF_ROLE,
    EGO_PATH,
    EGO_STATE,
    LANES,
    OBSERVER,
    OBSERVER_PATH,
    ONLINE_CHANNEL_OF_ROLE,
    OWN_TOPIC_PREFIX,
    TARGETS,
)
from cwcli.errors import MissingSignalError, UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.input_rows import CAN_FRAME_FIELDS, CAN_FRAME_SCHEMAS
from cwcli.signals.inputs import (
    SCHEMAS_BY_RADIO_FORMAT,
    find_input_for_role,
    inputs_of_schema,
    normalise_schema_name,
)
from cwcli.signals.role import Role

if TYPE_CHECKING:
    from cwcli.signals.builders.base import Input
    from cwcli.signals.mapping import FieldMapping

TRUTH_TOPIC_SEGMENTS = frozenset({"truth", "ground_truth", "groundtruth", "gt"})
"""Parts of topic names that mark a channel as reference values; chosen from the names in public logs."""
DESCRIPTION_BY_ROLE: dict[str, str] = {
    **{role: role.words for role in Role},
    **{role: channel.what for role, channel in CHANNEL_OF_ROLE.items()},
}
"""Role -> what fills it, in the words of error messages."""
HINT_BY_UNFILLED_ROLE: dict[str, str] = {
    **{role: role.hint for role in Role},
    **{role: f"run `cwcli {channel.stage} LOG -o annotated.mcap` first" for role, channel in CHANNEL_OF_ROLE.items()},
}
"""Role -> the hint of the error that nothing fills it."""
CHANNELS_FROM_CAMERA_TO_PREDICTED_PATH = (LANES, OBSERVER, OBSERVER_PATH)
"""Channels that lead from a camera to a predicted path without a position, in the order of their stages."""
ALL_ROLE_NAMES = tuple(DESCRIPTION_BY_ROLE)
"""Names of all roles: those of inputs, then those of cwcli's own channels."""
TRUTH_ROLES = frozenset({Role.TRUTH, Role.TARGET_TRUTH, Role.LATERAL_TRUTH})
"""Roles that only channels of reference values fill."""
ROLES_WITH_MANY_TOPICS = frozenset(
    {
        *(Role.REMOTE, Role.DETECTIONS),
        # two receivers or two IMUs, each with its own latency, place and noise
        *(Role.EGO_POSITION, Role.EGO_VELOCITY, Role.EGO_SPEED, Role.EGO_HEADING, Role.IMU),
    }
)
"""Roles that take several topics, each a source of its own."""
ROLES_OF_RADIO_MESSAGES = frozenset({Role.REMOTE, Role.EGO_POSITION, Role.EGO_SPEED, Role.EGO_HEADING})
"""The roles that a topic of undecoded radio messages can have (`--topic ROLE=TOPIC:FORMAT`): other vehicles, and
position, speed and heading of the ego."""
ROLES_THAT_MAY_BE_EMPTY = frozenset({TARGETS.role})
"""Roles that a channel without messages may fill: a list of targets is empty on an empty road."""
ROLES_FILLED_BY_ALL_CANDIDATE_CHANNELS = frozenset({Role.DETECTIONS})
"""Roles that all candidates fill together, because each is a sensor of its own."""


class ChannelLike(Protocol):
    """What binding needs to know of a channel."""

    @property
    def topic(self) -> str: ...
    @property
    def schema_name(self) -> str: ...
    @property
    def message_encoding(self) -> str: ...


ChannelWithInputs = tuple[ChannelLike, "Mapping[str, Input]"]
"""A channel and the registry's rows of its schema, by role."""


@dataclass(frozen=True)
class Binding:
    """A channel in a role.

    Attributes:
        topic, schema_name, message_encoding: The channel.
        is_override: The user named it.
        mapping: Which of its fields are the role's, where the user has said so.
        parts: The channels of the mapping's parts.
        input: The registry's row that reads the channel, found once; None for cwcli's own roles, which a stage reads.
    """

    role: str
    topic: str
    schema_name: str
    message_encoding: str
    is_override: bool = False
    mapping: FieldMapping | None = None
    parts: tuple[Binding, ...] = ()
    input: Input | None = field(default=None, compare=False, repr=False)

    @property
    def is_additive(self) -> bool:
        """Whether it is bound in addition to the channel that is chosen for the role."""
        return self.input is not None and self.input.is_additive

    @property
    def fields(self) -> tuple[str, ...]:
        """Leaf fields that the role needs of this channel."""
        if self.mapping is not None:
            return (
                CAN_FRAME_FIELDS
                if normalise_schema_name(self.schema_name) in CAN_FRAME_SCHEMAS
                else self.mapping.leaf_fields_to_load
            )
        return self.input.fields.get(self.message_encoding, ()) if self.input else ()


@dataclass(frozen=True)
class Bindings:
    """The outcome of `bind`.

    Attributes:
        by_role: str -> its channels: one, or several where the user listed them or each is a source of its own.
            Unbound roles are absent.
        notes: What the user should know, one line each.
        undecided: Roles that are unbound because several channels can fill them -> these.
    """

    by_role: Mapping[str, tuple[Binding, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    undecided: Mapping[str, tuple[Binding, ...]] = field(default_factory=dict)

    def __contains__(self, role: str) -> bool:
        return role in self.by_role

    def channels_of_role(self, role: str) -> tuple[Binding, ...]:
        """The channels of a role, () when it is not bound."""
        return self.by_role.get(role, ())

    def first_topic_of_role(self, role: str) -> str | None:
        """The (first) topic of a role, None when it is not bound."""
        bound = self.channels_of_role(role)
        return bound[0].topic if bound else None

    def fields_to_load(self) -> dict[str, set[str]]:
        """Topic -> leaf fields to load, for all roles that are read as columns (what `Log.load` takes)."""
        fields: dict[str, set[str]] = {}
        for bound in self.by_role.values():
            for binding in (each for one in bound for each in (one, *one.parts)):
                if leaves := binding.fields:
                    fields.setdefault(binding.topic, set()).update(leaves)
        return fields


def bind_roles(
    channels: Sequence[ChannelLike],
    overrides: Mapping[str, str],
    *,
    required: Collection[str],
    optional: Collection[str] = (),
    ego_station: str | None = None,
    where: str = "",
    command: str = "",
) -> Bindings:
    """Find the channels for a command's roles.

    Args:
        channels: All channels of the log.
        overrides: Role name -> topic (`--topic`); roles that this command does not use are ignored.
        required: Roles that the command can't do without.
        optional: Roles that it uses when they are there.
        ego_station: Station whose V2X messages are the ego's own, or None.
        where: Log name for messages.
        command: Command name for messages (`estimate`).

    Returns:
        The bindings.

    Raises:
        UsageError: An override names an unknown role, a topic that is not in the log, or one that can't fill the role.
        MissingSignalError: A required role has no candidate, or more than one.
    """
    named = _bind_overrides(channels, overrides, where)
    by_role: dict[str, tuple[Binding, ...]] = {}
    undecided: dict[str, tuple[Binding, ...]] = {}
    notes: list[str] = []
    known = _channels_with_inputs_by_role(channels)
    for role in dict.fromkeys((*required, *optional)):
        if role in named:
            by_role[role] = named[role]
            continue
        candidates = _candidate_bindings(known, role, ego_station)
        rivals = [each for each in candidates if not each.is_additive]
        if candidates and (len(rivals) <= 1 or role in ROLES_FILLED_BY_ALL_CANDIDATE_CHANNELS):
            by_role[role] = tuple(candidates)
            if role in ONLINE_CHANNEL_OF_ROLE and candidates[0].topic == ONLINE_CHANNEL_OF_ROLE[role].topic:
                notes.append(
                    f"no channel holds {DESCRIPTION_BY_ROLE[role]} in hindsight: "
                    f"{ONLINE_CHANNEL_OF_ROLE[role].topic} is used"
                )
        elif role in required:
            raise _missing_role_error(role, rivals, channels, where, command)
        elif candidates:
            undecided[role] = tuple(rivals)
            choice = _topic_option_text(role, rivals)
            notes.append(f"{_text_about_rival_channels(role, rivals)}; none is used (choose one with {choice})")
    return Bindings(by_role=by_role, notes=tuple(notes), undecided=undecided)


def is_truth_topic(topic: str) -> bool:
    """Whether a topic's name says that it holds reference values."""
    return not TRUTH_TOPIC_SEGMENTS.isdisjoint(topic.lower().split("/"))


def parse_role_overrides(options: Sequence[str], name_of_option: str = "--topic") -> dict[str, str]:
    """Read `ROLE=/topic` options.

    Args:
        options: One entry for each.
        name_of_option: For the messages of errors.

    Raises:
        UsageError: An option has no `=`, or a role comes twice.
    """
    overrides: dict[str, str] = {}
    for option in options:
        name, separator, topic = option.partition("=")
        if not separator or not topic:
            raise UsageError(f"{name_of_option} {option}: expected ROLE=/topic", hint=_role_names_text())
        if name in overrides:
            raise UsageError(
                f"{name_of_option} {name} is given twice", hint="several topics for one role: --topic remote=/a,/b"
            )
        overrides[name] = topic
    return overrides


def check_topic_overrides(overrides: Mapping[str, str], name_of_option: str = "--topic") -> None:
    """Check that every role (name -> topic) exists; else a UsageError that names the option."""
    for name, value in overrides.items():
        if name not in ALL_ROLE_NAMES:
            raise UsageError(
                f"{name_of_option} {name}={value}: there is no role {name}",
                hint=hint_at_closest_or_all_known_names(name, ALL_ROLE_NAMES, "roles"),
            )
        _parse_field_mappings(name, value)


def _channels_with_inputs_by_role(channels: Sequence[ChannelLike]) -> list[ChannelWithInputs]:
    """The channels with the registry's rows of their schemas, by role: each is looked up once."""
    return [
        (channel, {each.role: each for each in reversed(inputs_of_schema(channel.schema_name))}) for channel in channels
    ]


def _candidate_bindings(channels: Sequence[ChannelWithInputs], role: str, ego_station: str | None) -> list[Binding]:
    """The bindings of lowest rank for a role, then those that are bound in addition; one for each topic."""
    ranked: dict[str, tuple[int, Binding]] = {}
    for channel, input_by_role in channels:
        if role not in input_by_role and not channel.topic.startswith(OWN_TOPIC_PREFIX):
            continue
        if _is_known_to_be_empty(channel) and role not in ROLES_THAT_MAY_BE_EMPTY:
            continue
        binding = Binding(
            role, channel.topic, channel.schema_name, channel.message_encoding, input=input_by_role.get(role)
        )
        rank = _rank_or_none_if_only_by_name(binding, ego_station)
        if rank is not None:
            ranked.setdefault(channel.topic, (rank, binding))
    lowest = min((rank for rank, each in ranked.values() if not each.is_additive), default=0)
    found = [each for rank, each in ranked.values() if rank == lowest or each.is_additive]
    return sorted(found, key=lambda each: each.is_additive)


def _rank_or_none_if_only_by_name(binding: Binding, ego_station: str | None) -> int | None:
    """The priority of a channel for its role, 0 first; None if the channel does not fill it unless it is named."""
    role, topic, entry = binding.role, binding.topic, binding.input
    if role in CHANNEL_OF_ROLE:
        own = (
            CHANNEL_OF_ROLE[role].topic,
            *([ONLINE_CHANNEL_OF_ROLE[role].topic] if role in ONLINE_CHANNEL_OF_ROLE else []),
        )
        return own.index(topic) if topic in own and _can_schema_fill_role(role, binding.schema_name) else None
    if entry is None or topic.startswith(OWN_TOPIC_PREFIX) or (entry.needs_ego_station and ego_station is None):
        return None
    if not entry.says_what_it_is and is_truth_topic(topic) != (role in TRUTH_ROLES):
        return None
    return entry.rank if entry.fits_topic(topic) else None


def _can_schema_fill_role(role: str, schema_name: str) -> bool:
    own = CHANNEL_OF_ROLE.get(role)
    return (
        find_input_for_role(role, schema_name) is not None
        if own is None
        else normalise_schema_name(schema_name) == own.schema
    )


def _bind_overrides(
    channels: Sequence[ChannelLike], overrides: Mapping[str, str], where: str
) -> dict[str, tuple[Binding, ...]]:
    named: dict[str, tuple[Binding, ...]] = {}
    check_topic_overrides(overrides)
    for name, value in overrides.items():
        mappings = _parse_field_mappings(name, value)
        if mappings:
            named[name] = tuple(_bind_mapped_channel(channels, mapping, where) for mapping in mappings)
            continue
        topics = value.split(",") if name in ROLES_WITH_MANY_TOPICS else [value]
        named[name] = tuple(_bind_named_channel(channels, name, topic.strip(), where) for topic in topics)
    return named


def does_override_name_message_fields(role: str, value: str) -> bool:
    """Whether the value of `ROLE=value` names fields of messages, and not topics alone or a format of radio octets."""
    if ":" not in value or value.rpartition(":")[2] in SCHEMAS_BY_RADIO_FORMAT:
        return False
    from cwcli.signals.mapping import MAPPED_QUANTITIES_BY_ROLE  # few name fields, and every start would pay

    return role in MAPPED_QUANTITIES_BY_ROLE


def _parse_field_mappings(role: str, value: str) -> tuple[FieldMapping, ...]:
    """Parse the field mappings of `ROLE=value`; () where the value is topics. A malformed mapping is a UsageError."""
    if not does_override_name_message_fields(role, value):
        return ()
    from cwcli.signals.mapping import (  # few name fields, and every start would pay
        parse_field_mappings,
    )

    mappings = parse_field_mappings(role, value)
    if len(mappings) > 1 and role not in ROLES_WITH_MANY_TOPICS:
        raise UsageError(f"--map {role} is given twice", hint="it takes one channel")
    return mappings


def _bind_mapped_channel(channels: Sequence[ChannelLike], mapping: FieldMapping, where: str) -> Binding:
    from cwcli.signals.mapping import MAPPED_QUANTITIES_BY_ROLE

    for channel in channels:
        if channel.topic in (mapping.topic, f"/{mapping.topic}"):
            parts = tuple(_bind_mapped_channel(channels, part, where) for part in mapping.parts)
            whole = _make_named_binding(channel, mapping.role, MAPPED_QUANTITIES_BY_ROLE[mapping.role].schema)
            return replace(whole, mapping=mapping, parts=parts)
    topics = tuple(dict.fromkeys(channel.topic for channel in channels)) or ("no channels",)
    what = f"--map {mapping.role}={mapping.text}: the log has no topic {mapping.topic}"
    raise UsageError(what, where=where, found=topics)


def _bind_named_channel(channels: Sequence[ChannelLike], role: str, topic: str, where: str) -> Binding:
    if role in ROLES_OF_RADIO_MESSAGES and ":" in topic:
        return _bind_radio_channel(channels, role, topic, where)
    usable = {channel.topic: channel for channel in channels if _can_schema_fill_role(role, channel.schema_name)}
    channel = usable.get(topic) or usable.get(f"/{topic}")
    if channel is not None:
        return _make_named_binding(channel, role, channel.schema_name)
    option = f"--topic {role}={topic}"
    if usable:
        hint = f"topics that can hold {DESCRIPTION_BY_ROLE[role]}: {', '.join(usable)}"
    else:
        hint = f"no channel of this log can hold {DESCRIPTION_BY_ROLE[role]}"
    schema = next((channel.schema_name for channel in channels if channel.topic in (topic, f"/{topic}")), None)
    if schema is None:
        raise UsageError(f"{option}: the log has no topic {topic}", where=where, hint=hint)
    raise UsageError(
        f"{option}: {schema or 'no schema'} can't hold {DESCRIPTION_BY_ROLE[role]}", where=where, hint=hint
    )


def _bind_radio_channel(channels: Sequence[ChannelLike], role: str, named: str, where: str) -> Binding:
    """Bind a channel of undecoded radio messages that is named as `/topic:FORMAT`."""
    topic, _, form = named.rpartition(":")
    if form not in SCHEMAS_BY_RADIO_FORMAT:
        raise UsageError(
            f"--topic {role}={named}: there is no format {form}", hint=f"formats: {', '.join(SCHEMAS_BY_RADIO_FORMAT)}"
        )
    for channel in channels:
        if channel.topic in (topic, f"/{topic}"):
            schema_name = SCHEMAS_BY_RADIO_FORMAT[form]
            return replace(_make_named_binding(channel, role, schema_name), schema_name=schema_name)
    raise UsageError(f"--topic {role}={named}: the log has no topic {topic}", where=where)


def _missing_role_error(
    role: str, candidates: Sequence[Binding], channels: Sequence[ChannelLike], where: str, command: str
) -> MissingSignalError:
    needed = f" (needed by `cwcli {command}`)" if command else ""
    found = tuple(
        dict.fromkeys(
            f"{each.topic} ({each.schema_name or 'no schema'}{', no messages' if _is_known_to_be_empty(each) else ''})"
            for each in channels
        )
    )
    if candidates:
        return MissingSignalError(
            f"{_text_about_rival_channels(role, candidates)}{needed}",
            where=where,
            found=found,
            hint=f"choose one with {_topic_option_text(role, candidates)}",
        )
    fitting = [
        channel for channel in channels if role in (roles := _roles_of_channel(channel)) and Role.REMOTE not in roles
    ]
    if fitting and all(_is_known_to_be_empty(channel) for channel in fitting):
        topics = tuple(dict.fromkeys(channel.topic for channel in fitting))
        verb = "has" if len(topics) == 1 else "have"
        return MissingSignalError(
            f"no channel holds {DESCRIPTION_BY_ROLE[role]}{needed}: {', '.join(topics)} {verb} no messages",
            where=where,
            found=found,
            hint="record the log again, or name another channel with --topic or --map",
        )
    by_hand = [channel.topic for channel in fitting if not _is_known_to_be_empty(channel)]
    hint = _hint_at_camera_stages_or_empty(role, channels, command) or HINT_BY_UNFILLED_ROLE.get(role, "")
    if by_hand and role not in CHANNEL_OF_ROLE:
        hint = f"{hint}; " if hint else ""
        hint += f"{', '.join(dict.fromkeys(by_hand))} can be named with --topic {role}=/name"
    return MissingSignalError(
        f"no channel holds {DESCRIPTION_BY_ROLE[role]}{needed}", where=where, found=found or ("no channels",), hint=hint
    )


def _is_known_to_be_empty(channel: ChannelLike) -> bool:
    """Return whether the log says that the channel has no messages; not every log counts them."""
    return getattr(channel, "message_count", None) == 0


def _roles_of_channel(channel: ChannelLike) -> set[str]:
    """The roles that the schema of a channel can fill."""
    return {entry.role for entry in inputs_of_schema(channel.schema_name)}


def _hint_at_camera_stages_or_empty(role: str, channels: Sequence[ChannelLike], command: str) -> str:
    """A hint on the stages that give the ego's path from the camera in a log without a position; "" for other logs."""
    is_asked = command in ("predict", "warn", "run") and role in (EGO_STATE.role, EGO_PATH.role)
    known = _channels_with_inputs_by_role(channels)
    if not is_asked or _candidate_bindings(known, Role.EGO_POSITION, None):
        return ""
    topics = {channel.topic for channel in channels}
    steps = list(CHANNELS_FROM_CAMERA_TO_PREDICTED_PATH)
    while steps and any(step.topic in topics for step in steps):
        del steps[0]
    if len(steps) == len(CHANNELS_FROM_CAMERA_TO_PREDICTED_PATH) and not _candidate_bindings(known, Role.CAMERA, None):
        return ""
    words = [f"`cwcli {step.stage}`" for step in steps]
    has_speed = any(_candidate_bindings(known, each, None) for each in (Role.EGO_SPEED, Role.EGO_VELOCITY))
    if OBSERVER in steps and not has_speed:
        words[steps.index(OBSERVER)] += " (it needs the car's speed too, which no channel holds)"
    if command == "warn":
        words.append("`cwcli warn-lane`")
    return f"no channel holds a position for `cwcli estimate`; from the camera: {', '.join(words)}"


def _text_about_rival_channels(role: str, candidates: Sequence[Binding]) -> str:
    count = {2: "two"}.get(len(candidates), str(len(candidates)))
    names = [f"{candidate.topic} ({candidate.schema_name})" for candidate in candidates]
    return f"{count} channels hold {DESCRIPTION_BY_ROLE[role]}: {', '.join(names[:-1])} and {names[-1]}"


def _topic_option_text(role: str, candidates: Sequence[Binding]) -> str:
    topics = [candidate.topic for candidate in candidates]
    each = " or ".join(f"--topic {role}={topic}" for topic in topics)
    return (
        f"{each}, or several with commas: --topic {role}={','.join(topics)}" if role in ROLES_WITH_MANY_TOPICS else each
    )


def _role_names_text() -> str:
    return f"roles: {', '.join(ALL_ROLE_NAMES)}"


def _make_named_binding(channel: ChannelLike, role: str, read_as_schema: str) -> Binding:
    """The binding of a channel that the user named, read as messages of a schema."""
    entry = find_input_for_role(role, read_as_schema)
    return Binding(role, channel.topic, channel.schema_name, channel.message_encoding, is_override=True, input=entry)
