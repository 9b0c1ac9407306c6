"""Names of the logs that `cwcli find` searches: each log has one of its own, so none takes another's place."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cwcli.fleet import search


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
