"""Laws that every published channel obeys: what is written is in its schema, in order, and is read back as it was."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cwcli.channels.published import (
    POLICY_PLACEHOLDER,
    PUBLISHED_CHANNELS,
    Channel,
    schema_name_by_published_topic,
)
from cwcli.channels.warning import read_warnings
from cwcli.control.encounter import BRAKING_POLICY_NAMES
from cwcli.errors import DataError
from cwcli.logs.read.reader import Log
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import Strings
from tests.laws.channel_cases import (
    CASES,
    ROOT,
    N,
    Written,
)

EACH = pytest.mark.parametrize("case", CASES)
SIZE = pytest.mark.parametrize("n", [0, 1, N])


def assert_same(found: Any, expected: Any, where: str = "") -> None:
    """Equal arrays; strings are compared as they read."""
    if isinstance(expected, Strings):
        texts = ([each.values[code] if code >= 0 else "" for code in each.codes] for each in (found, expected))
        assert next(texts) == next(texts), where
    elif isinstance(expected, Mapping):
        for name, value in expected.items():
            assert_same(found[name], value, f"{where}.{name}")
    elif dataclasses.is_dataclass(expected):
        for each in dataclasses.fields(expected):
            assert_same(getattr(found, each.name), getattr(expected, each.name), f"{where}.{each.name}")
    elif where.endswith(("velocity", "variance")):  # by way of speed and heading, and of sigmas
        np.testing.assert_allclose(found, expected, rtol=1e-12, err_msg=where)
    else:
        np.testing.assert_array_equal(found, expected, err_msg=where)


def test_every_published_channel_is_here_and_nothing_else() -> None:
    written = [channel for case in CASES for channel in case(np.random.default_rng(1), N).channels]
    assert {channel.topic: channel.schema_name for channel in written} == schema_name_by_published_topic()
    roles = {channel.topic for channel in PUBLISHED_CHANNELS if channel.role}
    read = {topic for case in CASES for topic in case(np.random.default_rng(1), N).readers}
    assert roles <= read  # what later stages find has a reader


@EACH
@SIZE
def test_rows_are_in_log_order_not_before_their_stamps_and_all_there(
    case: Callable[[np.random.Generator, int], Written], n: int
) -> None:
    for channel in case(np.random.default_rng(2), n).channels:
        log_time_ns = channel.log_time_ns
        assert log_time_ns.dtype == np.int64
        assert (np.diff(log_time_ns) >= 0).all()
        assert all(len(column) == len(log_time_ns) for column in channel.fields.values())
        stamps = channel.fields.get("stamp_ns", channel.fields.get("timestamp"))
        if stamps is not None:
            assert (np.asarray(stamps) <= log_time_ns).all()


@EACH
@SIZE
def test_the_file_holds_as_many_messages_and_other_libraries_decode_them(
    case: Callable[[np.random.Generator, int], Written], n: int, tmp_path: Path
) -> None:
    channels = case(np.random.default_rng(3), n).channels
    with LogWriter(tmp_path / "log.mcap") as log:
        for channel in channels:
            log.write_columns(channel)
    counts = {channel.topic: 0 for channel in channels}
    with (tmp_path / "log.mcap").open("rb") as stream:
        for schema, channel_of, _, _ in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            assert schema is not None
            assert schema.name == schema_name_by_published_topic()[channel_of.topic]
            counts[channel_of.topic] += 1
    assert counts == {channel.topic: len(channel) for channel in channels}


@EACH
@SIZE
def test_what_is_read_back_is_what_was_given(
    case: Callable[[np.random.Generator, int], Written], n: int, tmp_path: Path
) -> None:
    written = case(np.random.default_rng(4), n)
    with LogWriter(tmp_path / "log.mcap") as writer:
        for channel in written.channels:
            writer.write_columns(channel)
    with Log.open(tmp_path / "log.mcap") as file, Log.open(ROOT / "sample_logs" / "straight.mcap") as other:
        memory = other.with_channels(written.channels)
        for topic, read in written.readers.items():
            for log in (file, memory):
                assert_same(read(log.columns(topic)), written.given[topic], topic)


@EACH
def test_a_channel_of_another_version_is_an_error_that_says_what_to_do(
    case: Callable[[np.random.Generator, int], Written],
) -> None:
    written = case(np.random.default_rng(5), N)
    for topic, read in written.readers.items():
        if read is read_warnings or topic.endswith("/lanes"):
            continue  # lenient: the report draws what there is
        with Log.open(ROOT / "sample_logs" / "straight.mcap") as log:
            columns = log.with_channels(written.channels).columns(topic)
        needed = next(
            name for name in ("sigma", "covariance", "x_m", *columns.fields) if name in {*columns.fields} - {"stamp_ns"}
        )
        for name in ("stamp_ns", needed):
            fields = {each: values for each, values in columns.fields.items() if each != name}
            if name == "covariance" and topic == "/cwcli/observer":
                continue  # a method may give none
            with pytest.raises(DataError) as raised:
                read(dataclasses.replace(columns, fields=fields))
            assert name in raised.value.what
            assert raised.value.where == topic
            assert "--replace" in raised.value.hint


def test_a_descriptor_of_a_policy_is_one_of_its_topics() -> None:
    own = [channel for channel in PUBLISHED_CHANNELS if POLICY_PLACEHOLDER in channel.topic]
    assert len(own) == 3
    of_all: list[Channel] = [channel.with_policy_in_topic(policy) for channel in own for policy in BRAKING_POLICY_NAMES]
    assert {channel.topic for channel in of_all} <= set(schema_name_by_published_topic())
