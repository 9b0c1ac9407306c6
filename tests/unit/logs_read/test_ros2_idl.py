"""Definitions in IDL, as rosbag2 writes them for types that have no `.msg` file: the values, and what is hostile."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_idl, get_typestore

from cwcli.errors import InputError
from cwcli.logs.codecs.ros2idl import MAX_IDL_CHARACTERS, ros2msg_text_of_idl
from cwcli.logs.codecs.ros2msg import SchemaError, parse_message_definitions
from cwcli.logs.read.reader import Log

OUTER = """module pkg { module msg {
  typedef double double__3[3];
  module Outer_Constants { const uint8 LEFT = 1; const uint32 N = 2; };
  @verbatim (language="comment", text= "An (outer" "\\n" "message")
  struct Outer {
    pkg::msg::Inner inner;
    sequence<pkg::msg::Inner, 4> others; /* at most
    four */ double__3 xyz;
    string<10> name;
    @default (value=3) int32 n;
    unsigned long long stamp;
    boolean is_on, is_off;
  };
}; };
"""
INNER = "module pkg { module msg { struct Inner { float x; }; }; };\n"
HEAD = "=" * 80 + '\nIDL: pkg/msg/{}\n// generated from rosidl\n#include "pkg/msg/Inner.idl"\n'
WRITTEN = HEAD.format("Outer") + OUTER + "\n" + HEAD.format("Inner") + INNER
ENCODED = struct.pack("<4xfI2f3dI4si4xQ??", 1.5, 2, 2.5, 3.5, *(1.0, 2.0, 3.0), 4, b"abc\0", 7, 9, True, False)


def database(path: Path, text: str) -> Path:
    """A database of rosbag2 (Jazzy) with a message of `pkg/msg/Outer`, whose definition is in IDL."""
    with closing(sqlite3.connect(path)) as opened, opened:
        opened.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
            "CREATE TABLE message_definitions(topic_type TEXT, encoding TEXT, encoded_message_definition TEXT);"
            "INSERT INTO topics VALUES(1, '/t', 'pkg/msg/Outer', 'cdr')"
        )
        opened.execute("INSERT INTO message_definitions VALUES('pkg/msg/Outer', 'ros2idl', ?)", (text,))
        opened.execute("INSERT INTO messages VALUES(1, 1, 1000, ?)", (b"\0\1" + ENCODED[2:],))
    return path


def test_a_message_in_a_message_of_idl(tmp_path: Path) -> None:
    with Log.open(database(tmp_path / "a.db3", WRITTEN)) as log:
        fields: Any = log.columns("/t").fields
    assert np.asarray(fields["inner.x"]).tolist() == [1.5]
    assert fields["others.x"].values.tolist() == [2.5, 3.5]
    assert np.asarray(fields["xyz"]).tolist() == [[1.0, 2.0, 3.0]]
    assert fields["name"].values == ("abc",)
    assert [int(np.asarray(fields[name])[0]) for name in ("n", "stamp", "is_on", "is_off")] == [7, 9, 1, 0]


def test_fields_are_those_of_the_library() -> None:
    """`rosbags` reads one definition at a time, without the lines that rosbag2 puts between them."""
    store = get_typestore(Stores.EMPTY)
    for text in (INNER, OUTER):
        store.fielddefs.update(get_types_from_idl(text))
    expected = parse_message_definitions("pkg/msg/Outer", store.generate_msgdef("pkg/msg/Outer", ros_version=2)[0])
    assert parse_message_definitions("pkg/msg/Outer", ros2msg_text_of_idl("pkg/msg/Outer", WRITTEN)) == expected


def test_a_definition_that_cannot_be_read_is_counted(tmp_path: Path) -> None:
    with Log.open(database(tmp_path / "a.db3", "union X switch (long) {};")) as log:
        assert log.n_messages == 1
        reason = "'union' begins no definition of IDL that is read"
        note = f"message types whose definition in IDL is not read (pkg/msg/Outer: {reason})"
        assert note in log.faults.counts_by_reason()
        assert not any("without a definition" in each for each in log.faults.counts_by_reason())


def test_hostile_definitions_of_a_database(tmp_path: Path) -> None:
    """Types that double have too many fields; definitions of 5 MB are refused before they are parsed."""
    doubling = "".join(f"struct T{k} {{ pkg::msg::T{k + 1} a, b; }};" for k in range(60))
    text = f"module pkg {{ module msg {{ struct Outer {{ T0 a; }}; {doubling} struct T60 {{ long x; }}; }}; }};"
    with Log.open(database(tmp_path / "a.db3", text)) as log, pytest.raises(InputError, match="65,536 fields"):
        log.columns("/t")
    with pytest.raises(InputError, match="definitions have more than"):
        Log.open(database(tmp_path / "b.db3", WRITTEN + "/" * 5_000_000))


@pytest.mark.parametrize("length", ["pkg::msg::N", "msg::N", "N", "::pkg::msg::N", "3"])
def test_a_length_is_a_number_or_a_constant_in_scope(length: str) -> None:
    """The constant of another module has the same last name, and comes later."""
    constants = "module pkg { module msg { const uint32 N = 3; }; }; module other { const uint32 N = 4; };"
    text = f"{constants} module pkg {{ module msg {{ struct Outer {{ long x[{length}]; }}; }}; }};"
    assert ros2msg_text_of_idl("pkg/msg/Outer", text) == "int32[3] x\n"


def test_the_nearest_type_and_the_global_one() -> None:
    text = "typedef long A; module pkg { typedef double A; struct Outer { A x; ::A y; }; };"
    assert ros2msg_text_of_idl("pkg/Outer", text) == "float64 x\nint32 y\n"


@pytest.mark.parametrize("length", ["2*N", "A+N", "A N", "1 2", "", "-1", "010", "::", "A::", "B", "E"])
def test_another_length_is_an_error(length: str) -> None:
    """An expression, two words, an octal number, and a constant that is out of scope or is an expression."""
    constants = "const long A = 1; const long N = 2; const long E = 2*N; module b { const long B = 5; };"
    with pytest.raises(SchemaError):
        ros2msg_text_of_idl("Outer", f"{constants} struct Outer {{ long x[{length}]; }};")


@pytest.mark.parametrize(
    "twice",
    ["const long A = {};", "typedef long A[{}];", "struct A {{ long x[{}]; }};"],
    ids=["const", "typedef", "struct"],
)
def test_a_name_with_two_meanings_is_an_error(twice: str) -> None:
    end = "struct Outer { long x; };"
    assert ros2msg_text_of_idl("Outer", twice.format(1) * 2 + end) == "int32 x\n"
    with pytest.raises(SchemaError, match="'A' is defined twice, and not alike"):
        ros2msg_text_of_idl("Outer", twice.format(1) + twice.format(2) + end)


@pytest.mark.parametrize("annotation", ["optional", "bit_bound(8)", "mutable", "appendable", "extensibility(MUTABLE)"])
def test_an_annotation_that_changes_the_bytes_is_an_error(annotation: str) -> None:
    """OMG XTypes 1.3: an optional field has a header, a mutable structure a list of ids, a bit bound fewer octets."""
    name = annotation.split("(", maxsplit=1)[0]
    for text in (f"@{annotation} struct Outer {{ long x; }};", f"struct Outer {{ @{annotation} long x; }};"):
        with pytest.raises(SchemaError, match=f"@{name} may change the bytes"):
            ros2msg_text_of_idl("Outer", text)


def test_other_annotations_do_not_change_the_bytes() -> None:
    text = '@final @verbatim(language="a", text="b") struct Outer { @key @unit(value="m") @default(value=3) long x; };'
    assert ros2msg_text_of_idl("Outer", text) == "int32 x\n"


def test_long_names_do_not_make_a_longer_text() -> None:
    """Each field names its type in full: few characters of IDL would make gigabytes of `ros2msg`."""
    for n_modules, n_characters, reason in ((1, 130_000, "characters"), (2, 200, "characters"), (1, 200, "makes more")):
        name = "m" * n_characters
        fields = "".join(f"A x{k};" for k in range(15_000))
        inside = f"struct A {{ long x; }}; struct Outer {{ {fields} }};"
        text = f"module {name} {{ " * n_modules + inside + " };" * n_modules
        assert len(text) < MAX_IDL_CHARACTERS
        with pytest.raises(SchemaError, match=reason):
            ros2msg_text_of_idl("/".join([name] * n_modules + ["Outer"]), text)


@pytest.mark.parametrize(
    "text",
    [
        "/*" * 100_000,
        '"\\' * 100_000,
        "@a(" * 60_000,
        "module a { " * 20_000,
        "struct Outer { " + "sequence<" * 20_000,
        "".join(f"typedef a{k + 1} a{k};" for k in range(9_000)) + "struct Outer { a0 x; };",
        "typedef long a[3]; struct Outer { a x[3]; };",
        "struct Outer { long x[99999999999999999999]; };",
        "struct Outer { long x[A]; };" + "const long A = 1;" * 9_000,
        "struct Outer { long x",
        "struct Outer { " + "x" * MAX_IDL_CHARACTERS,
        "=" * MAX_IDL_CHARACTERS,
        ("=" * 1000 + "\n") * (MAX_IDL_CHARACTERS // 1001),
        'struct "A" { long x; }; struct Outer { long x; };',
        "struct Outer { long " + "x" * 256 + "; };",
    ],
    ids=range(15),
)
def test_hostile_idl_is_an_error(text: str) -> None:
    with pytest.raises(SchemaError):
        ros2msg_text_of_idl("Outer", text)
