"""Names of the logs that `cwcli find` searches: each log has one of its own, so none takes another's place."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cwcli.errors import CwcliError, InputError, MissingSignalError
from cwcli.events.search import parse_query
from cwcli.fleet import search
from cwcli.logs.read.reader import Log
from tests.cli.conftest import ROOT


def test_logs_of_one_id_in_two_runs_keep_names_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def read_run(argument: str) -> SimpleNamespace:
        run = argument.rstrip("/")
        ids = {"runA": ("bend", "curve"), "runB": ("curve",)}[run]
        return SimpleNamespace(
            logs=[SimpleNamespace(id=id, find_annotated_log=lambda id=id: f"/{run}/logs/{id}.mcap") for id in ids]
        )

    monkeypatch.setattr(search, "read_run_or_none", read_run)
    assert search.logs_to_search(["runA/", "runB"]) == [
        ("bend", "/runA/logs/bend.mcap"),
        ("runA/curve", "/runA/logs/curve.mcap"),
        ("runB/curve", "/runB/logs/curve.mcap"),
    ]


def test_a_log_that_failed_in_its_run_is_named_and_not_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    curve = str(ROOT / "sample_logs" / "curve.mcap")
    logs = [
        SimpleNamespace(id=id, find_annotated_log=lambda path=path: path)
        for id, path in (("bend", None), ("curve", curve), ("dip", None))
    ]
    monkeypatch.setattr(search, "read_run_or_none", lambda argument: SimpleNamespace(logs=logs))
    found = search.find_in_logs(search.logs_to_search(["run"]), parse_query("all"), Log.open)
    assert [(name, error.what) for name, error in found.failed] == [
        ("bend", "its run left no annotated log of it"),
        ("dip", "its run left no annotated log of it"),
    ]


def test_where_no_log_can_be_searched_the_most_frequent_reason_leads_and_few_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The reasons of eight logs are named: three lack a topic, and five have an error that names the log."""
    reasons: list[CwcliError] = [InputError(f"no log: {k}", hint="another") for k in range(5)]
    reasons[2:2] = [MissingSignalError("there is no topic /a", hint="name one") for _ in range(3)]

    def fail(path: str) -> Log:
        raise reasons[int(path)]

    logs = [search.SearchedLog(f"log{k}", str(k)) for k in range(8)]
    with pytest.raises(MissingSignalError) as caught:
        search.find_in_logs(logs, parse_query("all"), fail)
    assert (caught.value.what, caught.value.hint) == ("none of the 8 logs could be searched", "name one")
    assert caught.value.found == (
        "there is no topic /a: log2, log3, log4",
        "no log: 0: log0",
        "no log: 1: log1",
        "and 3 more reasons",
    )
