"""The metrics of all logs together: pooled by samples and ways, spread as bars, with the logs that stand out."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cwcli.digest.story import Story
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.pooling import LogMetrics, metric_rows_by_name
from cwcli.report.page import OverviewRow, PageContent, PageRenderer
from cwcli.report.pooled import (
    HISTOGRAM_WIDTH_PX,
    N_HISTOGRAM_BINS,
    SourceInLog,
    build_histogram_and_axis_ends,
    find_outlier_logs,
    min_outlier_sigma,
    pool_metrics,
    pool_sources,
    read_ego_sources,
)
from cwcli.report.views import LogView, Plot, SensorsView


def log(name: str, errors_m: list[float], *, n_warnings: int = 0, distance_km: float = 1.0) -> LogMetrics:
    headline = HeadlineCollector()
    headline.add_errors("ego.position_rmse_m", np.array(errors_m))
    headline.add_from_sums("warnings.raised_per_100km", n_warnings, distance_km / 100.0, n=n_warnings)
    headline.add_count("data.read_count", 7)  # is not shown
    return LogMetrics(name, metric_rows_by_name(headline.to_table()))


def test_errors_are_pooled_by_their_samples_and_rates_by_their_ways() -> None:
    """sqrt((3 x 1 + 9) / 4) m, not the mean of 1 and 3 m; 3 warnings in 30 km are 10 in 100 km."""
    logs = [log("a", [1.0, -1.0, 1.0], n_warnings=3, distance_km=10.0), log("b", [3.0], distance_km=20.0)]
    error, rate = pool_metrics(logs, {})
    assert (error.name, rate.name) == ("ego.position_rmse_m", "warnings.raised_per_100km")
    assert float(error.value) == pytest.approx(math.sqrt(3.0), abs=1e-3)
    assert (error.n_logs, error.n_samples, error.median) == (2, 4, "2.000")
    assert float(rate.value) == pytest.approx(10.0)
    assert rate.between == "2.062 to 29.22"  # the exact Poisson interval of 3, 0.6187 to 8.7673, per 30 km


def test_one_log_and_failed_ones_are_not_pooled() -> None:
    assert pool_metrics([log("a", [1.0]), LogMetrics("b", error="it failed")], {}) == ()


def test_bars_hold_every_log_and_far_ones_stand_at_the_ends() -> None:
    values = np.array([1.0, 1.1, 1.2, 1.3, 1.4, 500.0])
    spread, low, high = build_histogram_and_axis_ends(values, "ego.position_rmse_m")
    assert sum(bar.n for bar in spread.bars) == 6
    # Quartiles by linear interpolation at places 1.25 and 3.75: 1.125 and 1.375; the axis ends at 1.375 + 3 x 0.25
    assert low == 1.0
    assert high == pytest.approx(2.125)
    assert (
        spread.bars[-1].x_px == pytest.approx((N_HISTOGRAM_BINS - 1) * HISTOGRAM_WIDTH_PX / N_HISTOGRAM_BINS)
        and spread.bars[-1].n == 1
    )
    assert (spread.low, spread.high) == ("1.000", "500.0")


@pytest.mark.parametrize("values", [[2.0, 2.0, 2.0], [0.0, 0.0], [5.0], [1.0, 1.0, 1.0, 1.0, 9.0]])
def test_values_that_agree_have_bars_too(values: list[float]) -> None:
    spread, low, high = build_histogram_and_axis_ends(np.array(values), "ego.position_rmse_m")
    assert sum(bar.n for bar in spread.bars) == len(values) and low < high


def test_the_farthest_logs_stand_out_with_their_places() -> None:
    """Median 1.0, median deviation 0.1: what is beyond 5 x 0.148 = 0.74 is far."""
    values = {"a": 0.9, "b": 1.0, "c": 1.1, "d": 1.0, "e": 0.9, "f": 1.7, "g": 1.8, "h": -3.0}
    odd = find_outlier_logs("ego.position_rmse_m", values, {"g": "log-7"}, 0.0, 2.0, 0.0)
    assert [(each.name, each.anchor, each.value) for each in odd] == [("h", "", "-3.000"), ("g", "log-7", "1.800")]
    assert [each.at_px for each in odd] == [0.0, pytest.approx(0.9 * HISTOGRAM_WIDTH_PX, abs=0.1)]
    assert find_outlier_logs("x", {"a": 0.0, "b": 0.0, "c": 99.0}, {}, 0.0, 1.0, 0.0) == ()  # three tell nothing
    assert find_outlier_logs("x", dict.fromkeys("abcd", 1.0), {}, 0.0, 1.0, 0.0) == ()


def test_sources_are_put_together_over_the_logs() -> None:
    def record(latency_s: float | None, nis: float, *, is_inside: bool, gated: int) -> dict[str, str]:
        entry = {
            "vehicle": "ego", "source": "/gps", "quantity": "yaw_rate", "latency_found_s": latency_s,
            "nis_per_dof": nis, "nis_inside": is_inside, "gated": gated, "used": 100 - gated,
        }  # fmt: skip
        other = {**entry, "vehicle": "17", "source": "/v2x"}
        return {"sources": json.dumps([entry, other, 3, "x"])}

    found = [
        *read_ego_sources("a", record(0.1, 1.0, is_inside=True, gated=0)),
        *read_ego_sources("b", record(0.3, 2.0, is_inside=False, gated=6)),
        *read_ego_sources("c", record(None, 4.0, is_inside=False, gated=0)),
        *read_ego_sources("d", {"sources": "{not json"}),
    ]
    (source,), n = pool_sources(found, {})
    assert n == 1
    assert (source.source, source.quantity, source.n_logs) == ("/gps", "yaw rate", 3)
    assert (source.latency, source.latency_between, source.nis) == ("200", "100 to 300", "2.00")
    assert (source.outside, source.gated) == ("2 of 3", "2.00 %")
    assert pool_sources(found[:1], {}) == ((), 0)


def found_source(log: str, latency_s: float = 0.1, *, gated: float = 0.0, used: float = 9.0) -> SourceInLog:
    return SourceInLog(log, "/gps", "speed", latency_s, 1.0, True, gated, used)


@pytest.mark.parametrize(
    ("gated", "used", "said"),
    [(5.0, 0.0, "100 %"), (997.0, 3.0, "99.7 %"), (0.0, 5.0, "0 %"), (0.0, 0.0, "-"), (1e308, 1e308, "-")],
)
def test_shares_of_what_was_gated_have_no_exponents(gated: float, used: float, said: str) -> None:
    """The last are counts of a record that anybody may have written: their sum is no number."""
    (source,), _ = pool_sources([found_source(log, gated=gated, used=used) for log in "ab"], {})
    assert source.gated == said


def test_latencies_that_no_source_has_are_left_out() -> None:
    for latency_s in (10**400, 1e306, -1e306, 86_401.0):
        entry = {"vehicle": "ego", "source": "/gps", "quantity": "speed", "latency_found_s": latency_s}
        (found,) = read_ego_sources("a", {"sources": json.dumps([entry])})
        assert math.isnan(found.latency_s)


def test_more_sources_than_fit_are_counted() -> None:
    found = [replace(found_source(log), source=f"/{k}") for log in "ab" for k in range(23)]
    sources, n = pool_sources([*found, replace(found_source("c"), source="/22")], {})
    assert (len(sources), n, sources[0].source) == (20, 23, "/22")
    page = PageContent(
        title="", headline="", sentences=(), badges=(), gates=(), columns=(), rows=(), footer=(),
        sources=sources, n_sources=n,
    )  # fmt: skip
    assert "20 of 23 are shown" in PageRenderer().render_page(page, [])
    assert "are shown" not in PageRenderer().render_page(replace(page, n_sources=20), [])


def test_where_most_logs_agree_ordinary_ones_do_not_stand_out() -> None:
    """Of counts one to five more are ordinary, of latencies what is within 25 ms; several are no odd ones."""
    counts = {**dict.fromkeys("abcdef", 0.0), "g": 1.0, "h": 5.0}
    least = min_outlier_sigma("warnings.missed_count", "")
    assert find_outlier_logs("warnings.missed_count", counts, {}, 0.0, 1.0, least) == ()
    counts["i"] = 6.0
    assert [each.name for each in find_outlier_logs("warnings.missed_count", counts, {}, 0.0, 1.0, least)] == ["i"]
    counts["j"] = 7.0  # two are no single odd log
    assert find_outlier_logs("warnings.missed_count", counts, {}, 0.0, 1.0, least) == ()
    times = {**dict.fromkeys("abc", 0.0), "d": 0.024}
    least = min_outlier_sigma("link.age_p95_s", "s")
    assert find_outlier_logs("link.age_p95_s", times, {}, 0.0, 1.0, least) == ()
    assert [each.name for each in find_outlier_logs("link.age_p95_s", {**times, "d": 0.026}, {}, 0.0, 1.0, least)] == [
        "d"
    ]
    sources, _ = pool_sources([found_source(log, 0.02 if log == "d" else 0.0) for log in "abcd"], {})
    assert sources[0].odd == ()
    sources, _ = pool_sources([found_source(log, 0.03 if log == "d" else 0.0) for log in "abcd"], {})
    assert [(each.name, each.value) for each in sources[0].odd] == [("d", "30.00")]


@pytest.mark.filterwarnings("error")
def test_values_near_the_largest_number_are_drawn_at_the_ends() -> None:
    values = np.array([1e308, -1e308, 0.0, 5.0])
    spread, low, high = build_histogram_and_axis_ends(values, "ego.position_rmse_m")
    assert sum(bar.n for bar in spread.bars) == 4 and math.isfinite(high - low)
    assert (spread.low, spread.high) == ("-1.000e+308", "1.000e+308")
    named = dict(zip("abcd", values.tolist(), strict=True))
    assert (
        find_outlier_logs("ego.position_rmse_m", named, {}, low, high, 0.0) == ()
    )  # half of them are far from the other half


def test_hostile_names_are_shown_as_what_they_are() -> None:
    """In the overview and in the sensors' figures of a page."""
    evil = "</script><script>alert(1)</script><img src=x onerror=alert(1)>"
    logs = [log(f"{evil}{k}", [float(value)]) for k, value in enumerate((1, 1, 1, 1, 99))]
    entries = [{"vehicle": "ego", "source": evil, "quantity": evil, "latency_found_s": 0.1}]
    found = [source for name in "ab" for source in read_ego_sources(name, {"sources": json.dumps(entries)})]
    plot = Plot(
        "log-1-residuals-1", "residuals", f"Residuals of {evil}", evil, {"data": [], "layout": {}}, height_px=240
    )
    sensors = SensorsView(evil, (), (evil,), plots=(plot,))
    story = Story(evil, (), ())
    renderer = PageRenderer()
    section = renderer.render_log_section(
        LogView("log-1", evil, story, (), is_alone=False, is_open=True, sensors=sensors)
    )
    page = PageContent(
        title=evil, headline=evil, sentences=(), badges=(), gates=(), columns=(),
        rows=(OverviewRow("", evil, (), evil, ()),), footer=(),
        metrics=pool_metrics(logs, {}), sources=pool_sources(found, {})[0],
    )  # fmt: skip
    html = renderer.render_page(page, [section])
    assert html.count("alert(1)") >= 10 and "<script>alert" not in html and "<img src=x" not in html
