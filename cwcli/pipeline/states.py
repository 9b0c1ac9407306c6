"""The states that a stage reads, of which there are two: what could have been known, and what really happened."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Literal

import numpy as np

from cwcli.channels.binding import Bindings, ChannelLike, bind_roles
from cwcli.channels.published import CHANNEL_OF_ROLE, EGO_STATE, ONLINE_CHANNEL_OF_ROLE
from cwcli.channels.vehicle_state import VehicleStates, read_vehicle_states, require_ego_states
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.call import Selection
from cwcli.pipeline.records import Record, read_configuration
from cwcli.pipeline.result import InputMessageCount
from cwcli.signals.clocks import INVALID_LOG_TIME_REASON, MAX_STAMP_NS
from cwcli.signals.columns import Columns

States = Literal["online", "hindsight"]
ChosenStates = Annotated[
    States,
    Option(
        "--states",
        "online: use the states that could be known at each moment; hindsight: use the states computed from the "
        "whole log.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class StatesSelection(Selection):
    """A selection with the kind of states that are read.

    Attributes:
        states: "online": estimated from earlier data only. "hindsight": estimated from the whole log.
    """

    states: ChosenStates = "online"


def choose_state_topics(
    topics: Mapping[str, str], which: States, channels: Sequence[ChannelLike], roles: Collection[str]
) -> dict[str, str]:
    """Return role -> topic: the choices of the user, and the online channels for the roles of states.

    A stage binds the role of the states in hindsight (`ego_state`) and gets the channel of the chosen kind. A choice by
    `--topic ego_state=` comes first. Where a log of another version has no online states, those in hindsight are used,
    and `note_if_hindsight_states_are_read` says so.
    """
    chosen = dict(topics)
    if which == "hindsight":
        return chosen
    topics_of_log = {channel.topic for channel in channels}
    for role in roles:
        if role not in ONLINE_CHANNEL_OF_ROLE or role in chosen:
            continue
        online = ONLINE_CHANNEL_OF_ROLE[role]
        if online.role in chosen:
            chosen[role] = chosen[online.role]
        elif online.topic in topics_of_log:
            chosen[role] = online.topic
    return chosen


def bind_state_channels(
    channels: Sequence[ChannelLike],
    selection: StatesSelection,
    *,
    required: Collection[str],
    optional: Collection[str] = (),
    where: str = "",
    command: str = "",
) -> Bindings:
    """Bind roles like `bind_roles`, with the chosen kind of states, and a note where states in hindsight are read.

    Raises:
        UsageError, MissingSignalError: As `bind_roles` does.
    """
    chosen = choose_state_topics(selection.topics, selection.states, channels, (*required, *optional))
    bound = bind_roles(channels, chosen, required=required, optional=optional, where=where, command=command)
    return replace(bound, notes=(*bound.notes, *note_if_hindsight_states_are_read(bound, selection)))


def note_if_paths_start_from_other_states(selection: StatesSelection, record: Record) -> tuple[str, ...]:
    """Return a note if the paths start from another kind of states than is read; `record` is that of `predict`."""
    used = read_configuration(record).get("states", "hindsight") if record else selection.states
    if used == selection.states:
        return ()
    return (f"the paths start from states of `--states {used}`, the rest is of `--states {selection.states}`",)


def note_if_hindsight_states_are_read(bound: Bindings, selection: StatesSelection) -> tuple[str, ...]:
    """Return a note if states in hindsight are read."""
    used = [
        role
        for role in bound.by_role
        if role in ONLINE_CHANNEL_OF_ROLE and bound.first_topic_of_role(role) == CHANNEL_OF_ROLE[role].topic
    ]
    if not used:
        return ()
    topics = ", ".join(CHANNEL_OF_ROLE[role].topic for role in used)
    if selection.states == "hindsight":
        return (f"states in hindsight ({topics}): they know what came later (--states hindsight)",)
    if used == ["targets"] or any(role in selection.topics for role in used):
        return (f"states in hindsight ({topics}): they know what came later",)
    return (f"the log has no online states: {topics} is read, which knows what came later; `cwcli estimate --replace`",)


def read_selected_states(
    log: Log, columns: Columns, role: str, selection: Selection
) -> tuple[VehicleStates, InputMessageCount]:
    """Read the states of a channel in the chosen span, and count its messages.

    Args:
        role: The role in which it is used.

    Raises:
        MissingSignalError: It is the ego's channel, and no state is left.
    """
    everything = read_vehicle_states(columns)
    is_time = (columns.log_time_ns >= 0) & (columns.log_time_ns <= MAX_STAMP_NS)
    n_out = len(everything) - int(np.count_nonzero(is_time))
    states = everything.select_rows(np.flatnonzero(is_time)) if n_out else everything
    states = states.select_logged_within(selection.start_ns, selection.end_ns)
    if role == EGO_STATE.role:
        require_ego_states(states, log_name=log.name, topic=columns.topic)
    rejected = {INVALID_LOG_TIME_REASON: n_out} if n_out else {}
    return states, InputMessageCount(columns.topic, role, len(everything), len(states), rejected)
