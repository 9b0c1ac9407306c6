"""Channels of cwcli's own in a log of others, with numbers that cwcli never writes: one line, and nothing is left."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from mcap.writer import Writer

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BAD_DATA, EXIT_DONE, EXIT_MISSING_SIGNAL, EXIT_USAGE
from cwcli.logs.codecs.protobuf import make_message_class
from cwcli.logs.codecs.ros2msg import SchemaError

NUMBERS: dict[str, Callable[[int], float]] = {
    "infinite": lambda k: float("inf"),
    "1e308": lambda k: (-1) ** k * 1e308,
    "leaps of 1e9": lambda k: (-1) ** k * 1e9,
    "nan": lambda k: float("nan"),
    "nothing": lambda k: 0.0,
}
COMMANDS = {
    "report": ("-o", "out.html"),
    "evaluate": (),
    "find": ("all",),
    "measure": ("-o", "out.mcap", "--replace"),
    "control": ("-o", "out.mcap", "--replace"),
    "warn": ("-o", "out.mcap", "--replace"),
    "predict": ("-o", "out.mcap", "--replace"),
    "export": ("--format", "ros2", "-o", "out.mcap"),
    "plot": ("-o", "out.svg"),
}
QUICK = {
    ("find", "leaps of 1e9"),
    ("find", "nan"),
    ("evaluate", "nothing"),
    ("evaluate", "1e308"),
    ("plot", "infinite"),
}


def write_with_number(source: Path, target: Path, number: Callable[[int], float]) -> None:
    """Write a log again, every double and float of cwcli's channels as the number of its message."""
    classes: dict[int, Any] = {}
    channels: dict[int, int] = {}
    with source.open("rb") as stream, target.open("wb") as out:
        reader, writer = make_reader(stream), Writer(out)
        writer.start()
        for k, (schema, channel, message) in enumerate(reader.iter_messages()):
            assert schema is not None
            if channel.id not in channels:
                number_of_schema = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number_of_schema
                )
                if channel.topic.startswith("/cwcli"):
                    pool = descriptor_pool.DescriptorPool()
                    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                        pool.Add(file)
                    kind = pool.FindMessageTypeByName(schema.name)
                    classes[channel.id] = message_factory.GetMessageClass(kind)
            data = message.data
            if channel.id in classes:
                parsed = classes[channel.id].FromString(data)
                set_numbers(parsed, number(k))
                data = parsed.SerializeToString()
            writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        writer.finish()


def set_numbers(message: Any, value: float) -> None:
    for field, inner in message.ListFields():
        if isinstance(inner, float):
            setattr(message, field.name, value)
        elif hasattr(inner, "ListFields"):
            set_numbers(inner, value)
        elif hasattr(inner, "__setitem__") and len(inner) and isinstance(inner[0], float):
            inner[:] = [value] * len(inner)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        pytest.param(command, name, marks=() if (command, name) in QUICK else pytest.mark.long)
        for command in COMMANDS
        for name in NUMBERS
    ],
)
def test_impossible_numbers_are_told(
    predicted: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    recwarn: pytest.WarningsRecorder,
    command: str,
    name: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_with_number(predicted, tmp_path / "in.mcap", NUMBERS[name])
    code = run_command_line([command, "in.mcap", *COMMANDS[command]])
    said = capfd.readouterr().err
    assert code in (EXIT_DONE, EXIT_BAD_DATA, EXIT_MISSING_SIGNAL, EXIT_USAGE), said
    assert "Traceback" not in said
    assert [str(each) for each in recwarn if each.category is RuntimeWarning] == []
    assert code == EXIT_DONE or {each.name for each in tmp_path.iterdir()} == {"in.mcap"}


def test_schema_of_too_many_types_in_a_chain_is_refused() -> None:
    file = descriptor_pb2.FileDescriptorProto(name="a.proto", package="p", syntax="proto3")
    for k in range(20_000):
        file.message_type.add(name=f"M{k}").field.add(
            name="next", number=1, type=11, label=1, type_name=f".p.M{(k + 1) % 20_000}"
        )
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    with pytest.raises(SchemaError, match="too deeply"):
        make_message_class(pool.FindMessageTypeByName("p.M0"))
