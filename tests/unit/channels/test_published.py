"""The list of published channels is complete: it has every topic that the stages and the schemas name."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from cwcli.channels.published import POLICY, PUBLISHED, topics
from cwcli.logs.schemas import message_schema, schema_folder

PACKAGE = Path(__file__).parents[3] / "cwcli"
TOPIC = re.compile(r"/cwcli/[\w/<>]*\w>?(?:/\w+)*")


def topics_in_code() -> Iterator[str]:
    """The literals of the stages that are topics; what an f-string fills in counts as the policy."""
    for path in sorted([*PACKAGE.glob("channels/*.py"), *PACKAGE.rglob("stages/**/*.py")]):
        if path.name in ("published.py", "layout.py"):  # the list itself; who only shows what is in it
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            text = ""
            if isinstance(node, ast.JoinedStr):
                text = "".join(part.value if isinstance(part, ast.Constant) else POLICY for part in node.values)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = node.value
            if re.fullmatch(r"/cwcli/[\w/<>]+[\w>]", text):
                yield text


def test_every_topic_in_the_stages_is_published() -> None:
    named = {topic for topic in topics_in_code() if topic != "/cwcli/control/"}
    assert len(named) >= 14
    assert named - {entry.topic for entry in PUBLISHED} == set()


def test_the_schemas_name_the_topics_of_their_messages() -> None:
    folder = schema_folder() / "cwcli" / "v1"
    text = "".join(entry.read_text(encoding="utf-8") for entry in folder.iterdir() if entry.name.endswith(".proto"))
    own = {entry.topic for entry in PUBLISHED if entry.schema.startswith("cwcli.v1.")}
    assert own - set(TOPIC.findall(text)) == set()


@pytest.mark.parametrize("schema", sorted({entry.schema for entry in PUBLISHED}))
def test_schema_is_there(schema: str) -> None:
    assert message_schema(schema).descriptor.full_name == schema


def test_topics_are_told_once_and_the_policies_are_filled_in() -> None:
    names = [entry.topic for entry in PUBLISHED]
    assert len(names) == len(set(names))
    assert topics()["/cwcli/control/driver/pose"] == "foxglove.PoseInFrame"
    assert not any("<" in topic for topic in topics())
    assert all(entry.what for entry in PUBLISHED if entry.schema.startswith("foxglove."))
