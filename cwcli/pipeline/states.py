"""The states that a stage reads, of which there are two: what could have been known, and what really happened."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from cwcli.channels.binding import Bindings, ChannelLike, bind
from cwcli.channels.published import EGO_STATE, OF_ROLE, ONLINE
from cwcli.channels.vehicle_state import VehicleStates, read_states, require_ego
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.call import Selection
from cwcli.pipeline.records import Record, configuration_of
from cwcli.pipeline.result import InputCount
from cwcli.signals.clocks import LOG_TIME_OUT, MAX_STAMP_NS
from cwcli.signals.columns import Columns

States = Literal["online", "hindsight"]
ChosenStates = Annotated[
    States,
    Option(
        "--states",
        "Start from the states as they could have been known when it happened, or from those in hindsight, which "
        "know what came later.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class OfStates(Selection):
    """A selection with the states that are read.

    Attributes:
        states: "online": as they could have been known at their log time. "hindsight": with all that came later.
    """

    states: ChosenStates = "online"


def with_states(
    topics: Mapping[str, str], which: States, channels: Sequence[ChannelLike], roles: Collection[str]
) -> dict[str, str]:
    """Role -> topic: the choices of the user, and the online channels for the states among the roles.

    A stage binds the role of the states in hindsight (`ego_state`) and gets the channel that was asked for. What the
    user names with `--topic ego_state=` counts; where a log has no online states (another version wrote it), those in
    hindsight are left, and `states_notes` tells.
    """
    chosen = dict(topics)
    if which == "hindsight":
        return chosen
    there = {channel.topic for channel in channels}
    for role in roles:
        if role not in ONLINE or role in chosen:
            continue
        online = ONLINE[role]
        if online.role in chosen:
            chosen[role] = chosen[online.role]
        elif online.topic in there:
            chosen[role] = online.topic
    return chosen


def bind_states(
    channels: Sequence[ChannelLike],
    selection: OfStates,
    *,
    required: Collection[str],
    optional: Collection[str] = (),
    where: str = "",
    command: str = "",
) -> Bindings:
    """`bind`, with the states that were asked for, and a note where they are not the online ones.

    Raises:
        UsageError, MissingSignalError: As `bind`.
    """
    chosen = with_states(selection.topics, selection.states, channels, (*required, *optional))
    bound = bind(channels, chosen, required=required, optional=optional, where=where, command=command)
    return replace(bound, notes=(*bound.notes, *states_notes(bound, selection)))


def paths_note(selection: OfStates, record: Record) -> tuple[str, ...]:
    """What to say where the paths start from other states than those that are read; `record` is that of `predict`."""
    used = configuration_of(record).get("states", "hindsight") if record else selection.states
    if used == selection.states:
        return ()
    return (f"the paths start from states of `--states {used}`, the rest is of `--states {selection.states}`",)


def states_notes(bound: Bindings, selection: OfStates) -> tuple[str, ...]:
    """What to say where states in hindsight are read."""
    used = [role for role in bound.by_role if role in ONLINE and bound.topic(role) == OF_ROLE[role].topic]
    if not used:
        return ()
    topics = ", ".join(OF_ROLE[role].topic for role in used)
    if selection.states == "hindsight":
        return (f"states in hindsight ({topics}): they know what came later (--states hindsight)",)
    if used == ["targets"] or any(role in selection.topics for role in used):
        return (f"states in hindsight ({topics}): they know what came later",)
    return (f"the log has no online states: {topics} is read, which knows what came later; `cwcli estimate --replace`",)


def chosen_states(log: Log, columns: Columns, role: str, selection: Selection) -> tuple[VehicleStates, InputCount]:
    """The states of a channel in the chosen span, and what became of its messages.

    Args:
        log: The log.
        columns: The channel.
        role: What it is used as.
        selection: Of the log.

    Raises:
        MissingSignalError: It is the ego's channel, and no state is left.
    """
    everything = read_states(columns)
    is_time = (columns.log_time_ns >= 0) & (columns.log_time_ns <= MAX_STAMP_NS)
    n_out = len(everything) - int(np.count_nonzero(is_time))
    states = everything.rows(np.flatnonzero(is_time)) if n_out else everything
    states = states.logged_within(selection.start_ns, selection.end_ns)
    if role == EGO_STATE.role:
        require_ego(states, log_name=log.name, topic=columns.topic)
    rejected = {LOG_TIME_OUT: n_out} if n_out else {}
    return states, InputCount(columns.topic, role, len(everything), len(states), rejected)
