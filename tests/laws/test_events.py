"""Laws of every event in the registry: `pytest tests/laws/test_events.py -k cut-in`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.errors import MissingSignalError, UsageError
from cwcli.events import EVENTS
from cwcli.events.base import MAX_SEVERITY
from cwcli.events.evidence import EventEvidence
from cwcli.events.search import find_events_in_log, parse_query
from cwcli.logs.read.reader import Log
from tests.laws.planted_drives import planted_drive, quiet_drive, write_drive

KINDS = ("near-miss", "cut-in", "lane-change", "stop-and-go")


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Drives with some events, and one of a second."""
    folder = tmp_path_factory.mktemp("drives")
    paths = [write_drive(planted_drive(kind, 5), folder / f"{kind}.mcap", 5) for kind in KINDS]
    return [*paths, write_drive(quiet_drive(np.random.default_rng(1), 1.0), folder / "short.mcap")]


@pytest.mark.parametrize("name", EVENTS)
def test_moments_lie_in_the_log_and_have_a_severity(drives: list[Path], name: str) -> None:
    for path in drives:
        with Log.open(path) as log:
            try:
                moments = list(EVENTS[name].find(EventEvidence(log)))
            except (MissingSignalError, UsageError):
                continue  # it says what it needs
            for each in moments:
                assert log.start_ns <= each.start_ns <= each.end_ns <= log.end_ns
                assert 0.0 <= each.severity <= MAX_SEVERITY
                assert each.actors


@pytest.mark.parametrize("name", EVENTS)
def test_the_name_alone_is_an_expression_and_its_words_are_told(name: str) -> None:
    assert parse_query(name).events == (name,)
    event = EVENTS[name]
    assert event.summary
    assert event.source
    assert event.needs
    assert event.value_name.replace("_", "").isalnum()


@pytest.mark.parametrize("name", EVENTS)
def test_the_same_log_gives_the_same_ids(drives: list[Path], name: str) -> None:
    runs = []
    for _ in range(2):
        with Log.open(drives[0]) as log:
            try:
                runs.append([each.id for each in find_events_in_log(log, parse_query(name)).found])
            except (MissingSignalError, UsageError):
                runs.append([])
    assert runs[0] == runs[1]
    assert len(set(runs[0])) == len(runs[0])
