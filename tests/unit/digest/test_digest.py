"""What a digest says of errors, of the way to warnings, and of the car: cases by hand."""

from __future__ import annotations

import json
from typing import Any

from cwcli.digest.digest import _reason_for_no_warnings, confidence_sentences, stage_sentence
from cwcli.evaluation.doubts.evidence import DoubtEvidence


def record(*sections: dict[str, Any], notes: tuple[str, ...] = ()) -> dict[str, str]:
    return {"summary": json.dumps({"sections": sections, "notes": notes})}


def section(key: str, columns: list[str], *rows: list[Any]) -> dict[str, Any]:
    return {"key": key, "title": key, "columns": columns, "rows": list(rows)}


def test_place_in_the_lane_is_compared_with_the_true_lane() -> None:
    errors = section(
        "observer_errors", ["state", "RMS error"], ["yaw_rate_radps", 0.5], ["lateral_deviation_m", 0.0114]
    )
    assert confidence_sentences(DoubtEvidence({"observe": record(errors)})) == (
        "Compared with the true lane in the log, the place in the lane is 0.011 m off (RMS).",
    )
    errors["rows"][1][1] = None  # no frame with a true lane
    assert confidence_sentences(DoubtEvidence({"observe": record(errors)})) == ()


def test_car_is_named_where_it_is_one_of_the_stations() -> None:
    sources = section("sources", ["source"], ["/v2x/bsm"], ["/v2x/bsm"])
    plain = stage_sentence("estimate", {"estimate": record(sources)}, {})
    assert plain == "The car's motion was estimated from /v2x/bsm."
    notes = ("/v2x/bsm: it rained", "/v2x/bsm: the car is V2X station 17, named by --ego-station")
    named = stage_sentence("estimate", {"estimate": record(sources, notes=notes)}, {})
    assert named == f"{plain[:-1]}: the car is V2X station 17, named by --ego-station."


def test_missing_warnings_are_told_by_what_is_missing() -> None:
    none = "No collision warnings were computed:"
    motion, position = "no channel holds the ego state", "no channel holds the ego position"
    assert _reason_for_no_warnings({}) == ()
    assert _reason_for_no_warnings({"warn": "nobody else is there"}) == (f"{none} nobody else is there.",)
    assert _reason_for_no_warnings({"warn": motion, "estimate": position}) == (
        f"{none} the log lacks the car's position.",
    )
    other = f"{motion} (another way: --stage lanes,warn-lane)"
    assert _reason_for_no_warnings({"warn": other, "estimate": position}) == (
        f"{none} the log lacks the car's position; `cwcli run` with --stage lanes,warn-lane warns of leaving the lane.",
    )
    assert _reason_for_no_warnings({"warn-lane": "no camera"}) == ("No lane warnings were computed: no camera.",)
