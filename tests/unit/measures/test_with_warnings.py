"""Which measures `cwcli warn` adds to its table of pairs: those that ask for it, no other."""

from __future__ import annotations

from dataclasses import fields

from cwcli.evaluation.scored_warnings import _build_pairs_table
from cwcli.measures import MEASURES
from cwcli.measures.base import Measure
from cwcli.registry import hide_plugins


def test_a_measure_joins_the_table_of_pairs_only_where_it_asks() -> None:
    (default,) = [field.default for field in fields(Measure) if field.name == "with_warnings"]
    assert default is False
    with hide_plugins():
        asking = {name for name, measure in MEASURES.items() if measure.with_warnings}
    assert asking >= {"distance", "gap", "ttc", "pet", "drac"}
    columns = _build_pairs_table((), host_id="ego").columns
    assert {name for name, measure in MEASURES.items() if measure.extreme_column_name in columns} == {
        name for name, measure in MEASURES.items() if measure.with_warnings
    }
