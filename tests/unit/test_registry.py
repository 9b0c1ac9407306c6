"""A registry: built-in entries first, imported when they are asked for, then those of other packages by name."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from cwcli.errors import EXIT_TERMINATED, EXIT_USAGE, DataError, PluginError, Terminated, UsageError
from cwcli.registry import Plugin, Registry, accept_dataclass_of, guard_plugin_function
from tests.cli.plugin_package import install


@dataclass(frozen=True)
class Thing:
    summary: str


def registry(**builtin: Thing | str) -> Registry[Thing]:
    return Registry("thing", "cwcli.things", builtin, accept_dataclass_of(Thing, {}))


def test_plugins_come_last_and_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = "from things import Thing\nA, B = Thing('a'), Thing('b')\n"
    install(tmp_path, {"cwcli.things": {"zebra": "stuff.all:B", "ape": "stuff.all:A"}}, {"all": code}, package="stuff")
    monkeypatch.setitem(sys.modules, "things", sys.modules[__name__])
    monkeypatch.syspath_prepend(str(tmp_path))
    things = registry(own=Thing("ours"))
    assert list(things) == ["own", "ape", "zebra"]
    assert len(things) == 3
    assert things.describe() == {"own": "ours", "ape": "a", "zebra": "b"}
    assert things.format_help() == "own: ours; ape: a; zebra: b."
    assert things.completions("z") == [("zebra", "b")]
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


class OwnInterrupt(KeyboardInterrupt):
    """A plug-in's own kind of interrupt, which nobody's Ctrl-C raises."""


class Unprintable(BaseException):
    def __str__(self) -> str:
        raise ValueError("no words")


PLUGIN = Plugin("near", "extra.rule:RULE", "extra 1.2", "warning rule")
RAISED = [SystemExit(1), GeneratorExit(), OwnInterrupt("enough"), BaseException("own"), Unprintable(), ValueError("x")]


@pytest.mark.parametrize("raised", RAISED, ids=lambda raised: type(raised).__name__)
def test_whatever_a_plugin_raises_is_an_error_that_names_it(raised: BaseException) -> None:
    """One that is no Exception would end the process with 1, which means a failed gate."""

    def decide() -> None:
        raise raised

    with pytest.raises(PluginError, match=r"rule 'near' of the package extra 1\.2 raised in decide: ") as told:
        guard_plugin_function(decide, "decide", None, PLUGIN)()
    assert type(raised).__name__ in str(told.value)
    assert told.value.exit_code == EXIT_USAGE
    with pytest.raises(PluginError, match="returned from decide what it must not: "):
        guard_plugin_function(int, "decide", lambda result: decide(), PLUGIN)()


@pytest.mark.parametrize("raised", [KeyboardInterrupt(), Terminated(), DataError("known")], ids=repr)
def test_what_is_not_the_plugins_fault_passes(raised: BaseException) -> None:
    def decide() -> None:
        raise raised

    with pytest.raises(type(raised)) as passed:
        guard_plugin_function(decide, "decide", None, PLUGIN)()
    assert passed.value is raised


def test_termination_has_its_own_exit_code() -> None:
    assert Terminated().code == EXIT_TERMINATED


def test_an_entry_that_fails_when_it_is_accepted_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = """from things import Thing
class Sly(Thing):
    def __init__(self, summary):
        if hasattr(self, 'summary'): raise GeneratorExit
        super().__init__(summary)
        type(self).summary = summary
A = Sly('a')
"""
    install(tmp_path, {"cwcli.things": {"ape": "sly_stuff.all:A"}}, {"all": code}, package="sly_stuff")
    monkeypatch.setitem(sys.modules, "things", sys.modules[__name__])
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PluginError, match=r"'ape' of the package sly_stuff 1\.2 can't be used: GeneratorExit"):
        registry()["ape"]
