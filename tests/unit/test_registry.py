"""A registry: built-in entries first, imported when they are asked for, then those of other packages by name."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from cwcli.errors import UsageError
from cwcli.registry import Registry, plugin_entry
from tests.cli.plugin_package import install


@dataclass(frozen=True)
class Thing:
    summary: str


def registry(**builtin: Thing | str) -> Registry[Thing]:
    return Registry("thing", "cwcli.things", builtin, plugin_entry(Thing, {}))


def test_plugins_come_last_and_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = "from things import Thing\nA, B = Thing('a'), Thing('b')\n"
    install(tmp_path, {"cwcli.things": {"zebra": "stuff.all:B", "ape": "stuff.all:A"}}, {"all": code}, package="stuff")
    monkeypatch.setitem(sys.modules, "things", sys.modules[__name__])
    monkeypatch.syspath_prepend(str(tmp_path))
    things = registry(own=Thing("ours"))
    assert list(things) == ["own", "ape", "zebra"]
    assert len(things) == 3
    assert things.describe() == {"own": "ours", "ape": "a", "zebra": "b"}
    assert things.help() == "own: ours; ape: a; zebra: b."
    assert things.complete("z") == [("zebra", "b")]
    assert things["ape"] is things["ape"]


def test_an_entry_is_imported_when_it_is_asked_for() -> None:
    things = registry(own="tests.unit.no_such_module:THING")
    assert "own" in things
    with pytest.raises(ModuleNotFoundError):
        things["own"]


def test_require_names_what_there_is() -> None:
    things = registry(one=Thing("1"), two=Thing("2"))
    assert things.require("two").summary == "2"
    with pytest.raises(UsageError, match="there is no thing 'three'") as error:
        things.require("three")
    assert error.value.hint == "one of: one, two"
    assert "three" not in things
