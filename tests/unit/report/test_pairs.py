"""Tables of the others in the report: extremes and conflicts by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cwcli.digest.drive import OtherTrack
from cwcli.digest.encounters import find_encounters
from cwcli.measures.pair import ActualTrack
from cwcli.report.pairs import (
    MAX_LISTED_CONFLICTS,
    conflicts_table,
    pair_extremes_table,
    stable_anchor_names,
    unwarned_conflict_links,
)
from tests.unit.report.test_encounters import NORTH, drive, straight, warning


def test_extremes_of_a_pair_are_those_of_two_straight_ways() -> None:
    """60 m ahead, 4 m/s slower: after 10 s 20 m, outlines of 4.5 m 15.5 m apart, TTC 15.5/4 s, DRAC 4²/(2 * 15.5)."""
    met = drive(straight(0.0, 60.0, 6.0, NORTH), None)
    table = pair_extremes_table(met, find_encounters(met))
    assert table is not None
    assert [name for name, _ in table.columns][1:4] == ["nearest [m]", "at [s]", "least gap [m]"]
    values = ("vehicle 7", "20.00", "10.0", "15.50", "10.0", "3.88", "10.0", "0.52", "10.0", "0", "0")
    assert table.rows == (values,)


def test_where_both_stood_is_not_how_near_they_came() -> None:
    """The other comes to 8 m and stands there, while the ego stands: nearest it was when it last moved."""
    stamp_ns, state = straight(0.0, 58.0, 10.0, -NORTH)
    state[:, 1] = np.maximum(state[:, 1], 8.0)
    state[:, 2] = np.where(state[:, 1] > 8.0, 10.0, 0.0)
    state[101:, 1] = 7.9  # a state drifts while its car stands
    met = drive((stamp_ns, state), None, moves=False)
    nearest = find_encounters(met).nearest
    assert nearest is not None and not nearest.is_parked
    assert nearest.stamp_ns < 5_000_000_000 and nearest.distance_m > 8.0 - 4.5


def test_a_pair_that_only_ever_stood_is_parked() -> None:
    met = drive(straight(3.0, 0.0, 0.0, NORTH), None, moves=False)
    nearest = find_encounters(met).nearest
    assert nearest is not None and nearest.is_parked and math.isclose(nearest.distance_m, 3.0 - 1.8)


def test_who_moves_comes_before_who_is_parked() -> None:
    parked, passing = straight(3.0, 0.0, 0.0, NORTH), straight(-40.0, 12.0, 8.0, 0.0)
    met = drive(None, None, moves=False)
    others = tuple(
        OtherTrack(name, "vehicle", ActualTrack(*way), (4.5, 1.8)) for name, way in (("1", parked), ("2", passing))
    )
    nearest = find_encounters(replace(met, others=others)).nearest
    assert nearest is not None and nearest.other.id == "2"
    assert math.isclose(nearest.distance_m, 12.0 - 0.9 - 2.25)  # half a width and half a length


def test_each_conflict_has_a_name_and_its_warnings() -> None:
    """They meet at 5 s at the origin's crossing: closer than 2.5 m for 2.5/sqrt(200) s before and after."""
    way = straight(50.0, 50.0, 10.0, math.pi)
    warned, unwarned = drive(way, warning(3.0, "7")), drive(way, warning(9.0, "8"))
    for met, said in ((warned, "warning 1"), (unwarned, "nobody")):
        meetings = find_encounters(met)
        table = conflicts_table(met, meetings, "x.mcap")
        assert table is not None
        assert table.rows == (("vehicle 7", "4.8", "5.2", "0.00", "5.0", said),)
        assert table.row_marks == tuple(stable_anchor_names("x.mcap", "conflict", [("7",)]))
    assert unwarned_conflict_links(find_encounters(warned), "x.mcap") == []
    assert table is not None
    assert unwarned_conflict_links(find_encounters(unwarned), "x.mcap") == [
        (table.row_marks[0], "conflict with vehicle 7")
    ]


def test_no_link_leads_beyond_the_rows_of_the_table() -> None:
    met = drive(straight(50.0, 50.0, 10.0, math.pi), None)
    meetings = find_encounters(met)
    many = replace(meetings, conflicts=type(meetings.conflicts)(list(meetings.conflicts) * (MAX_LISTED_CONFLICTS + 3)))
    table = conflicts_table(met, many, "x.mcap")
    assert table is not None and len(table.rows) == MAX_LISTED_CONFLICTS < len(many.conflicts)
    assert tuple(mark for mark, _ in unwarned_conflict_links(many, "x.mcap")) == table.row_marks
