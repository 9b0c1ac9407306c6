"""What a digest says of errors, of the way to warnings, and of the car: cases by hand."""

from __future__ import annotations

import json
from typing import Any

from cwcli.digest.digest import _reason_for_no_warnings, confidence_sentences
from cwcli.digest.stage_sentences import stage_sentence
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


def test_other_way_to_warnings_is_an_option() -> None:
    reason = "no channel holds the ego state"
    motion = "No warnings were computed: the car's motion is not known"
    assert _reason_for_no_warnings({}) == ()
    assert _reason_for_no_warnings({"warn": reason}) == (f"{motion}.",)
    assert _reason_for_no_warnings({"warn": f"{reason} (another way: --stage lanes,warn-lane)"}) == (
        f"{motion}; `cwcli run` with --stage lanes,warn-lane gives some.",
    )
