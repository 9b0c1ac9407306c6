"""Message schemas that cwcli writes: its own `cwcli.v1.*`, the standard `foxglove.*` ones, and `osi3.GroundTruth`.

The standard schemas come from Foxglove's own package `foxglove-schemas-protobuf`, so that they are exactly what viewers
know. That of OSI is ASAM's (release 3.8.0, MPL-2.0), compiled and unchanged: its source is at
github.com/OpenSimulationInterface/open-simulation-interface.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module, resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING

from cwcli.lazy_dataclass import dataclass

if TYPE_CHECKING:
    from google.protobuf.descriptor import Descriptor, FileDescriptor
    from google.protobuf.descriptor_pool import DescriptorPool

CWCLI_DESCRIPTOR_SET_FILE = "cwcli_v1.binpb"
"""The file with the compiled `cwcli.v1` schemas."""
OSI_DESCRIPTOR_SET_FILE = "osi3_ground_truth.binpb"
"""The file with the compiled schemas of ASAM OSI 3.8.0."""


@dataclass(frozen=True)
class MessageSchema:
    """A protobuf message as an MCAP schema.

    Attributes:
        name: Full name, e.g. `cwcli.v1.VehicleState`.
        data: Serialised `FileDescriptorSet` with everything that the message needs, dependencies first.
        descriptor: For the encoder.
    """

    name: str
    data: bytes
    descriptor: Descriptor


@cache
def find_message_schema(name: str) -> MessageSchema:
    """Return the schema of a message by its full name.

    Raises:
        KeyError: There is no such message.
    """
    standard = name.startswith("foxglove.")
    descriptor_file = OSI_DESCRIPTOR_SET_FILE if name.startswith("osi3.") else CWCLI_DESCRIPTOR_SET_FILE
    descriptor = (
        _find_foxglove_descriptor(name)
        if standard
        else _load_descriptor_pool(descriptor_file).FindMessageTypeByName(name)
    )
    return MessageSchema(name, _serialize_descriptor_set(descriptor.file), descriptor)


def schema_folder() -> Traversable:
    """Return the folder with the `.proto` files and descriptor sets: in the installed package or in the checkout."""
    try:
        return resources.files("cwcli.schemas")
    except ModuleNotFoundError:
        return Path(__file__).parents[3] / "schemas"


@cache
def _load_descriptor_pool(set_name: str) -> DescriptorPool:
    """Load a descriptor set of `schema_folder`."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool

    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString((schema_folder() / set_name).read_bytes()).file:
        pool.Add(file)
    return pool


def _find_foxglove_descriptor(name: str) -> Descriptor:
    short_name = name.removeprefix("foxglove.")
    try:
        module = import_module(f"foxglove_schemas_protobuf.{short_name}_pb2")
    except ModuleNotFoundError as error:
        raise KeyError(name) from error
    descriptor: Descriptor = module.DESCRIPTOR.message_types_by_name[short_name]
    return descriptor


def _serialize_descriptor_set(file: FileDescriptor) -> bytes:
    """Serialise a file and all that it imports as a `FileDescriptorSet`, dependencies first, each once."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    ordered: dict[str, FileDescriptor] = {}

    def add_file_after_dependencies(node: FileDescriptor) -> None:
        for dependency in node.dependencies:
            add_file_after_dependencies(dependency)
        ordered.setdefault(node.name, node)

    add_file_after_dependencies(file)
    descriptor_set = FileDescriptorSet()
    for node in ordered.values():
        node.CopyToProto(descriptor_set.file.add())
    data: bytes = descriptor_set.SerializeToString(deterministic=True)
    return data
