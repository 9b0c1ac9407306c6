"""The table of published channels: every topic is spelled there and nowhere else, and each has what belongs to it."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from cwcli.channels.published import (
    CHANNEL_OF_ROLE,
    POLICY_PLACEHOLDER,
    PUBLISHED_CHANNELS,
    Channel,
    schema_name_by_published_topic,
)
from cwcli.logs.encoders.schemas import find_message_schema, schema_folder

ROOT = Path(__file__).parents[3]
TOPIC = re.compile(r"(?<!\w)/cwcli/[\w/<>]*[\w>]")
EACH = pytest.mark.parametrize("channel", PUBLISHED_CHANNELS, ids=lambda channel: channel.topic)


def spelled_topics() -> dict[str, set[str]]:
    """What string literals of the package, docstrings aside, say below `/cwcli/` -> the files that say it."""
    found = defaultdict(set)
    for path in sorted((ROOT / "cwcli").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        words = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in words:
                for topic in TOPIC.findall(node.value):
                    found[topic].add(path.relative_to(ROOT).as_posix())
    return found


def test_every_topic_is_spelled_in_one_file() -> None:
    spelled = spelled_topics()
    published = {channel.topic: {"cwcli/channels/published.py"} for channel in PUBLISHED_CHANNELS}
    examples = {"/cwcli/camera"}  # of options for topics that the user names
    assert {topic: files for topic, files in spelled.items() if topic not in examples} == published


def test_one_module_beside_the_table_writes_each_channel() -> None:
    """A descriptor without a file of its own would be a topic that nobody writes."""
    names = {name: value for name, value in vars(sys.modules[Channel.__module__]).items() if isinstance(value, Channel)}
    assert tuple(names.values()) == PUBLISHED_CHANNELS
    users = defaultdict(set)
    for path in sorted((ROOT / "cwcli").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == Channel.__module__:
                for alias in node.names:
                    users[alias.name].add(path.name)
    assert {name for name in names if not users[name]} == set()


@EACH
def test_schema_is_there_and_its_comment_names_the_topic(channel: Channel) -> None:
    assert find_message_schema(channel.schema).descriptor.full_name == channel.schema
    if channel.schema.startswith("cwcli.v1."):
        folder = schema_folder() / "cwcli" / "v1"
        files = [entry for entry in folder.iterdir() if entry.name.endswith(".proto")]
        text = "".join(entry.read_text(encoding="utf-8") for entry in files)
        assert channel.topic in TOPIC.findall(text)


@EACH
def test_the_channel_reference_has_a_row(channel: Channel) -> None:
    page = (ROOT / "docs" / "channels.md").read_text(encoding="utf-8")
    role = f"`{channel.role}`" if channel.role else ""
    assert f"| `{channel.topic}` | `{channel.schema}` | `{channel.stage}` | {role} | {channel.what} |" in page


def test_topics_and_roles_are_told_once_and_the_policies_are_filled_in() -> None:
    names = [channel.topic for channel in PUBLISHED_CHANNELS]
    assert len(names) == len(set(names))
    roles = [channel.role for channel in PUBLISHED_CHANNELS if channel.role]
    assert len(roles) == len(set(roles)) == len(CHANNEL_OF_ROLE)
    assert schema_name_by_published_topic()["/cwcli/control/driver/pose"] == "foxglove.PoseInFrame"
    assert not any(POLICY_PLACEHOLDER in topic for topic in schema_name_by_published_topic())
    assert all(channel.what and channel.stage for channel in PUBLISHED_CHANNELS)


def test_the_table_takes_no_numpy() -> None:
    code = "import sys, cwcli.channels.published; assert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
