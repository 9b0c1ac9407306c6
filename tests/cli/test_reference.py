"""The generated pages of docs/ are those that the code would write now."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.channel_reference import parse
from tools.reference import pages

PAGES = pages()


@pytest.mark.parametrize("path", list(PAGES), ids=lambda path: path.name)
def test_page_is_up_to_date(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == PAGES[path], "run `python -m tools.reference`"


def test_parse_reads_comments_of_messages_fields_and_enums() -> None:
    text = """
// One thing.
//
// More of it.
message Thing {
  enum Kind {
    // Good.
    KIND_GOOD = 1;
  }

  // Where.
  double x_m = 1;
  double y_m = 2;
  repeated Kind kinds = 3;
}
"""
    kind, thing = parse(text)
    assert (kind.kind, kind.name, [(f.name, f.number, f.comment) for f in kind.fields]) == (
        "enum",
        "Thing.Kind",
        [("KIND_GOOD", "1", "Good.")],
    )
    assert thing.comment == ["One thing.", "", "More of it."]
    assert [(f.kind, f.name, f.comment) for f in thing.fields] == [
        ("double", "x_m", "Where."),
        ("double", "y_m", ""),
        ("repeated Kind", "kinds", ""),
    ]


def test_channels_page_has_every_field_of_the_compiled_schemas() -> None:
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    from cwcli.logs.encoders.schemas import CWCLI_DESCRIPTOR_SET_FILE, schema_folder

    page = next(text for path, text in pages().items() if path.name == "channels.md")
    sections = {part.split("\n")[0]: part for part in page.split("\n## ")[1:]}
    files = FileDescriptorSet.FromString((schema_folder() / CWCLI_DESCRIPTOR_SET_FILE).read_bytes()).file
    messages = [message for file in files if file.package == "cwcli.v1" for message in file.message_type]
    assert len(messages) >= 6
    for message in messages:
        section = sections[f"cwcli.v1.{message.name}"]
        for field in message.field:
            assert f"| `{field.name}` |" in section
