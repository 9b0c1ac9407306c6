"""Messages as logs, written by official libraries.

A ROS message is written as JSON, and as CDR with the definition of its package or one made from its fields; a foxglove
or cwcli one also as protobuf.
"""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2.writer import Writer as Ros2Writer

from cwcli.logs.encoders.schemas import CWCLI_DESCRIPTOR_SET_FILE, schema_folder
from tests.laws.input_messages import DELAY_NS, Message, stamp_of
from tests.laws.receiver_messages import DEFINITIONS


def write_log(path: Path, schema: str, encoding: str, topic: str, messages: list[Message]) -> Path:
    """A log of these messages by the official writers."""
    write = {"json": _write_json, "cdr": _write_cdr, "protobuf": _write_protobuf}[encoding]
    with path.open("wb") as stream:
        write(stream, schema, topic, messages)
    return path


def _times(k: int) -> dict[str, int]:
    at = stamp_of(k) + DELAY_NS
    return {"log_time": at, "publish_time": at}


def _write_json(stream: Any, schema: str, topic: str, messages: list[Message]) -> None:
    writer = Writer(stream)
    writer.start()
    channel = writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))
    for k, message in enumerate(messages):
        writer.add_message(channel, data=json.dumps(message).encode(), **_times(k))
    writer.finish()


def _write_cdr(stream: Any, schema: str, topic: str, messages: list[Message]) -> None:
    writer = Ros2Writer(stream)
    package, _, name = schema.rpartition("/")
    messages = [{key.lower(): value for key, value in message.items()} for message in messages]  # as ROS 2 asks for
    registered = writer.register_msgdef(f"{package}/msg/{name}", DEFINITIONS.get(schema) or definition(messages[0]))
    for k, message in enumerate(messages):
        writer.write_message(topic, registered, message, **_times(k))
    writer.finish()


def definition(message: Message) -> str:
    """A `ros2msg` definition that fits a message."""
    texts: list[str] = []

    def add(fields: Message) -> str:
        lines = [f"{kind(value)} {name}" for name, value in fields.items()]
        texts.append("\n".join(lines))
        return f"made_msgs/Made{len(texts)}"

    def kind(value: Any) -> str:
        if isinstance(value, dict):
            return add(value)
        if isinstance(value, list):
            return f"{kind(value[0])}[]" if isinstance(value[0], (dict, int)) else f"float64[{len(value)}]"
        return {str: "string", int: "int64", float: "float64", bool: "bool"}[type(value)]

    add(message)
    *parts, top = texts
    return f"\n{'=' * 80}\n".join([top, *(f"MSG: made_msgs/Made{k}\n{text}" for k, text in enumerate(parts, start=1))])


def _write_protobuf(stream: Any, schema: str, topic: str, messages: list[Message]) -> None:
    kind = message_class(schema)
    writer = Writer(stream)
    writer.start()
    described = build_file_descriptor_set(kind).SerializeToString()
    channel = writer.register_channel(topic, "protobuf", writer.register_schema(schema, "protobuf", described))
    for k, message in enumerate(messages):
        made = json_format.ParseDict(with_times(message), kind(), ignore_unknown_fields=False)
        writer.add_message(channel, data=made.SerializeToString(), **_times(k))
    writer.finish()


def message_class(schema: str) -> Any:
    """The official protobuf class of a schema."""
    package, _, name = schema.rpartition(".")
    if package == "foxglove":
        return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
    if package == "osi3":
        return getattr(importlib.import_module(f"osi3.osi_{name.lower()}_pb2"), name)
    files = descriptor_pb2.FileDescriptorSet.FromString((schema_folder() / CWCLI_DESCRIPTOR_SET_FILE).read_bytes())
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema))


def with_times(message: Any) -> Any:
    """The message with its times as protobuf's JSON has them."""
    if isinstance(message, list):
        return [with_times(each) for each in message]
    if not isinstance(message, dict):
        return message
    if set(message) == {"sec", "nanosec", "nsec"}:
        made = importlib.import_module("google.protobuf.timestamp_pb2").Timestamp()
        made.seconds, made.nanos = message["sec"], message["nanosec"]
        return made.ToJsonString()
    return {name: with_times(value) for name, value in message.items()}
