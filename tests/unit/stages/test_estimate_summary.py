"""What `estimate` tells of each source's latency: a table for people, a table of numbers, the record of the run."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import pytest

from cwcli.estimation import Kind, Latency, LatencyStatus, SourceReport
from cwcli.estimation.imu import ImuMounting
from cwcli.estimation.parameter import Parameter, ParameterStatus, SlowError
from cwcli.estimation.result import TrackSummary
from cwcli.estimation.summary import build_estimate_table, format_source_diagnostics_json
from cwcli.stages.summaries.estimate import estimate_tables

NAN = math.nan
FLAGGED = {"starting": 2, "after_reset": 0, "bridged": 1, "rejecting": 0}
CASES = {
    "/applied": (Latency(LatencyStatus.APPLIED, 0.4551, 0.0882), "455 +- 88", 0.4551),
    "/drifts": (Latency(LatencyStatus.DRIFTS, 0.0961, 0.0074, 0.004, 6e-4, 148.0), "96 +- 7", 0.0961),
    "/insignificant": (Latency(LatencyStatus.NOT_SIGNIFICANT, -0.0042, 0.0071), "-4 +- 7", 0.0),
    "/unobservable": (Latency(LatencyStatus.NOT_OBSERVABLE), "", 0.0),
    "/given": (Latency(LatencyStatus.GIVEN, 0.3), "300", 0.3),
    "/reference": (Latency(LatencyStatus.REFERENCE), "", 0.0),
    "/off": (Latency(LatencyStatus.OFF), "", 0.0),
}


@pytest.fixture
def tracks() -> dict[str, TrackSummary]:
    reports = tuple(SourceReport(source, Kind.POSITION, latency=case[0]) for source, case in CASES.items())
    return {"ego": TrackSummary(10, 1.0, 5.0, 0.1, FLAGGED, reports, ())}


def test_table_of_sources_tells_value_sigma_and_status(tracks: dict[str, TrackSummary]) -> None:
    table = next(section for section in estimate_tables(tracks) if section.key == "sources")
    rows = {str(row[0]): dict(zip(table.columns, row, strict=True)) for row in table.rows}
    for source, (latency, text, _) in CASES.items():
        assert rows[source]["latency +- sigma [ms]"] == text
        assert rows[source]["latency status"] == latency.status.value
    assert rows["/insignificant"]["latency status"] == "not significant"


def test_table_of_metrics_holds_what_was_applied_beside_what_was_found(tracks: dict[str, TrackSummary]) -> None:
    table: Mapping[str, Any] = build_estimate_table(tracks)["estimate"].columns
    cells = zip(table["source"], table["metric"], table["value"], strict=True)
    values = {(str(source), str(metric)): float(value) for source, metric, value in cells}
    for source, (latency, _, applied_s) in CASES.items():
        assert values[source, "latency"] == applied_s
        assert values[source, "latency_found"] == pytest.approx(latency.found_s, nan_ok=True)
        assert values[source, "latency_sigma"] == pytest.approx(latency.sigma_s, nan_ok=True)


def test_record_holds_what_was_applied_and_why(tracks: dict[str, TrackSummary]) -> None:
    record = {entry["source"]: entry for entry in json.loads(format_source_diagnostics_json(tracks))}
    for source, (latency, _, applied_s) in CASES.items():
        assert record[source]["latency_s"] == applied_s
        assert record[source]["latency_status"] == latency.status.value
        assert record[source]["latency_drift"] == latency.drift
    assert (record["/insignificant"]["latency_found_s"], record["/insignificant"]["latency_sigma_s"]) == (
        -0.0042,
        0.0071,
    )
    assert record["/unobservable"]["latency_found_s"] is None
    assert record["/given"]["latency_sigma_s"] is None


def test_table_of_parameters_has_a_line_for_each_that_was_looked_for() -> None:
    used, little = ParameterStatus.USED, ParameterStatus.NOT_OBSERVABLE
    reports = (
        SourceReport(
            "/gps",
            Kind.POSITION,
            stamp_error=Parameter(0.0205, 0.00059, used),
            slow_error=SlowError(0.8, 12.0, used),
        ),
        SourceReport("/wheel", Kind.SPEED, scale=Parameter(0.9866, 0.0012, used), lever_arm_m=Parameter(status=little)),
        SourceReport(
            "/imu",
            Kind.ACCEL,
            bias=-1.75,
            bias_sigma=0.022,
            slow_error=SlowError(0.3, 30.0, used),
            mounting=ImuMounting(-0.175, 0.0),  # 10 degrees nose down, to which -1.71 m/s^2 of gravity belong
        ),
        SourceReport("/imu", Kind.YAW_RATE),
    )
    found = estimate_tables({"ego": TrackSummary(10, 1.0, 5.0, 0.1, FLAGGED, reports, ())})
    table = next(section for section in found if section.key == "parameters")
    assert table.rows == (
        ("/gps", "position", "stamp jitter (sigma)", "0.0205 +- 0.00059", "s", "applied"),
        ("/gps", "position", "slow error", "0.8 for 12 s", "m", "applied"),
        ("/wheel", "speed", "scale", "0.9866 +- 0.0012", "", "applied"),
        ("/wheel", "speed", "lever arm", "", "m", "not observable"),
        ("/imu", "accel", "bias", "-1.75 +- 0.022", "m/s^2", "applied"),
        ("/imu", "accel", "grade", "0.3 for 30 s", "m/s^2", "applied"),
    )


def test_tables_have_no_parameters_where_none_was_looked_for(tracks: dict[str, TrackSummary]) -> None:
    assert [section.key for section in estimate_tables(tracks)] == ["sources", "noise", "vehicles"]
