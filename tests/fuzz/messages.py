"""Cases of the level `kernel`: a schema, sometimes a mutated one, and mutated messages of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace

from google.protobuf.descriptor_pb2 import FileDescriptorSet

from tests.fuzz.mutate import NUMBERS, Rng, mutate
from tests.unit.logs_read.test_cdr import PRIMITIVES, Definitions, encode
from tests.unit.logs_read.test_json import random_value
from tests.unit.logs_read.test_protobuf import message_class, odd_schema, random_message

N_INPUTS = 16
"""Messages of a case."""
N_BASES = 3
"""Messages that they are mutated from: the official encoders are slow."""
MUTATED_SCHEMAS = 0.3
PROJECTED = 0.3
ROOT = "test_msgs/Root"
ROS_TOKENS = tuple(
    each.encode()
    for each in (
        *(*PRIMITIVES, "string", "wstring", "Header", "time", "duration", ROOT, f"MSG: {ROOT}\n", "=" * 80 + "\n"),
        *("[]", "[3]", "[0]", "[16777216]", "[99999999999]", "[<=3]", "\n", "#", "f0", " ", "/"),
    )
)
JSON_TOKENS = tuple(
    each.encode(errors="surrogatepass")
    for each in (
        *("{", "}", "[", "]", ":", ",", '"', "\\", " ", '{"k1":', '"k0":', "[[", "[" * 250, "null", "true", "false"),
        *("NaN", "-Infinity", "1e400", "-0.0", "0.1", "9007199254740993", "123456789012345678901234567890", "1" * 70),
        *("\\ud800", "\\u0000", "é", "\ud800"),
    )
)
PROTOBUF_FIELDS = ["one_1", "some_3", "text", "inner.x", "inners.many", "inners.x", "choice_text", "maybe", "colour"]
ENCAPSULATIONS = (0, 1, 1, 1, 6, 7, 3, 200)


@dataclass(frozen=True)
class Messages:
    """Messages of one channel.

    Attributes:
        encoding: `cdr`, `protobuf` or `json`.
        schema_name, schema: "" and b"" for JSON.
        payloads: The messages.
        fields: Wanted leaves, or None for all.
        blobs: Octet fields that are wanted as they are.
        n_at_once: Messages that the decoder gets together, one behind the other.
    """

    encoding: str
    schema_name: str
    schema: bytes
    payloads: tuple[bytes, ...]
    fields: tuple[str, ...] | None = None
    blobs: tuple[str, ...] = ()
    n_at_once: int = N_INPUTS


def make_messages(rng: Rng) -> Messages:
    """The messages of a case."""
    return replace(_MAKERS[int(rng.integers(len(_MAKERS)))](rng), n_at_once=int(rng.choice([1, N_INPUTS])))


def _cdr(rng: Rng) -> Messages:
    definitions = Definitions(int(rng.integers(1 << 31)))
    definitions.message(ROOT, 2)
    text = definitions.text()
    bases = []
    for _ in range(N_BASES):
        base = bytearray(encode(ROOT, text, definitions.value(ROOT)))
        base[1] = ENCAPSULATIONS[int(rng.integers(len(ENCAPSULATIONS)))]
        bases.append(bytes(base))
    schema = text.encode()
    if rng.random() < MUTATED_SCHEMAS:
        schema = mutate(rng, schema, ROS_TOKENS)
    names = [name for name, _, _ in definitions.fields[ROOT]]
    octets = [name for name, kind, shape in definitions.fields[ROOT] if kind in ("byte", "uint8") and shape]
    return Messages("cdr", ROOT, schema, _mutants(rng, bases), _some(rng, names), tuple(octets[:1]))


def _protobuf(rng: Rng) -> Messages:
    schema = odd_schema("proto3" if rng.random() < 0.5 else "proto2")
    make = message_class(schema)
    bases = [random_message(rng, make).SerializeToString() for _ in range(N_BASES)]
    if rng.random() < MUTATED_SCHEMAS:
        schema = _mutated_descriptors(rng, schema) if rng.random() < 0.7 else mutate(rng, schema)
    blobs = ("blob",) if rng.random() < 0.5 else ()
    return Messages("protobuf", "test.Root", schema, _mutants(rng, bases), _some(rng, PROTOBUF_FIELDS), blobs)


def _mutated_descriptors(rng: Rng, schema: bytes) -> bytes:
    """Descriptors that can still be parsed, with other types, numbers, labels, names and nesting."""
    files = FileDescriptorSet.FromString(schema)
    messages = list(files.file[0].message_type)
    for _ in range(int(rng.integers(1, 6))):
        message = messages[int(rng.integers(len(messages)))]
        field = message.field[int(rng.integers(len(message.field)))]
        change = int(rng.integers(7))
        if change == 0:
            field.type = int(rng.integers(1, 19))
        elif change == 1:
            field.number = int(rng.choice([1, 2, 19_000, 536_870_911, -1, int(rng.integers(1, 120))]))
        elif change == 2:
            field.label = int(rng.integers(1, 4))
        elif change == 3:
            field.type, field.type_name = 11, str(rng.choice([".test.Root", ".test.Inner", ".test.Deep", ".no.Such"]))
        elif change == 4:
            files.file[0].syntax = str(rng.choice(["proto2", "proto3", "editions", ""]))
        elif change == 5:
            field.name = str(rng.choice(["x", "", "a.b", "é"]))
        else:
            field.options.packed = bool(rng.integers(2))
    return files.SerializeToString()


def _json(rng: Rng) -> Messages:
    bases = [
        json.dumps({f"k{k}": random_value(rng, 3) for k in range(4)}, ensure_ascii=bool(rng.integers(2))).encode(
            errors="surrogatepass"
        )
        for _ in range(N_BASES)
    ]
    fields = _some(rng, ["k0", "k1", "k2.k0", "k3.k1.k2"])
    return Messages("json", "", b"", _mutants(rng, bases, JSON_TOKENS), fields)


def _mutants(rng: Rng, bases: list[bytes], tokens: tuple[bytes, ...] = NUMBERS) -> tuple[bytes, ...]:
    """Of each base itself, too: the values of whole messages are compared, not only those of broken ones."""
    mutants = [mutate(rng, bases[int(rng.integers(len(bases)))], tokens) for _ in range(N_INPUTS - len(bases))]
    made = [*bases, *mutants]
    return tuple(made[k] for k in rng.permutation(len(made)))


def _some(rng: Rng, names: list[str]) -> tuple[str, ...] | None:
    if rng.random() > PROJECTED:
        return None
    return tuple(name for name in names if rng.random() < 0.5) or (names[0],)


_MAKERS: tuple[Callable[[Rng], Messages], ...] = (_cdr, _protobuf, _json)
