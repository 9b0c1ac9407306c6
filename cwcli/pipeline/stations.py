"""Which stations a log was heard from, for somebody whose ego is one of them and who has not said so."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Collection

import numpy as np

from cwcli.errors import CwcliError, MissingSignalError
from cwcli.logs.read.reader import Log
from cwcli.signals.build import build_signal
from cwcli.signals.canonical import RemoteSignal
from cwcli.signals.inputs import find_input_for_role
from cwcli.signals.remotes import perceived_rows_mask
from cwcli.signals.role import Role
from cwcli.text import escape_control_characters, format_count

MAX_STATIONS_IN_ERROR = 5
"""Greatest number of stations that an error message names; chosen by hand."""


def add_stations_to_error(
    error: MissingSignalError, log: Log, *, ego_station: str | None, topics: Collection[str] | None = None
) -> MissingSignalError:
    """Return the error with the V2X stations of the log, and a hint at the option that makes one of them the ego.

    Args:
        error: That the ego's position is missing or ambiguous.
        ego_station: The ego's station that the user named. If it was heard, no other is hinted at.
        topics: Only stations of these topics count; None for all.

    Returns:
        The error as it is where the log holds no V2X message that can be read.
    """
    n_stations = sum(
        (n for topic, n in count_stations_by_topic(log).items() if topics is None or topic in topics), Counter()
    )
    if not n_stations:
        return error
    named = ", ".join(
        f"{escape_control_characters(station)} ({format_count(n, 'message')})"
        for station, n in n_stations.most_common(MAX_STATIONS_IN_ERROR)
    )
    more = f" and {len(n_stations) - MAX_STATIONS_IN_ERROR} more" if len(n_stations) > MAX_STATIONS_IN_ERROR else ""
    first = n_stations.most_common(1)[0][0]
    is_heard = ego_station is not None and ego_station.lower() in {station.lower() for station in n_stations}
    return MissingSignalError(
        error.what,
        where=error.where,
        found=(*error.found, f"V2X stations {named}{more}"),
        hint=error.hint
        if is_heard
        else f"if the ego is one of the stations, name it: --ego-station {shell_quote_station_id(first)}",
    )


def shell_quote_station_id(station: str) -> str:
    """Return a station's ID as a shell takes it after `--ego-station`, without control characters."""
    return shlex.quote(escape_control_characters(station))


def count_stations_by_topic(log: Log) -> dict[str, Counter[str]]:
    """Count the usable messages of each station, for each V2X topic of the log."""
    topics = {
        channel.topic: entry.fields.get(channel.message_encoding, ())
        for channel in log.channels
        if (entry := find_input_for_role(Role.REMOTE, channel.schema_name)) is not None
    }
    counts_by_topic: dict[str, Counter[str]] = {}
    try:
        for topic, columns in log.load_topics(topics).items() if topics else ():
            signal, _ = build_signal(Role.REMOTE, columns)
            assert isinstance(signal, RemoteSignal)
            sent = signal.station.codes[~perceived_rows_mask(signal)]
            counts = counts_by_topic.setdefault(topic, Counter())
            for station, n in zip(signal.station.values, np.bincount(sent), strict=False):
                counts[station] += int(n)
    except CwcliError:  # the channel is damaged: what was missing is still what is wrong
        return counts_by_topic
    return counts_by_topic
