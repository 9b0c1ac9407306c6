"""Tables of metrics that are not what they should be: one line, and never another log's trouble."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from pyarrow import parquet

from cwcli.errors import InputError
from cwcli.fleet.results import read_run_metrics
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.table import Table, write_table
from cwcli.report.source import MAX_LOGS_WITH_ALL_METRICS, read_reported_run


def metrics_table(path: Path, **changed: Any) -> Path:
    """A table with one metric of one log; `changed` columns hold one other value."""
    headline = HeadlineCollector()
    headline.add_from_sums("ego.position_rmse_m", 1.0, 10.0)
    table = headline.to_table()
    write_table(Table("metrics", {"log": ["a"], **table.columns}), path, force=True)
    found = parquet.read_table(path, partitioning=None)
    for name, value in changed.items():
        found = found.set_column(found.column_names.index(name), name, pa.array([value]))
    parquet.write_table(found, path)
    return path


@pytest.mark.parametrize(
    "changed",
    [
        {"value": "<b>"},
        {"value": [1.0]},
        {"value": None},
        {"n": 1.5},
        {"n": None},
        {"total": "1"},
        {"metric": 5},
        {"pool": 1.0},
    ],
    ids=str,
)
def test_columns_of_another_type_are_one_line(tmp_path: Path, changed: dict[str, Any]) -> None:
    path = metrics_table(tmp_path / "m.parquet", **changed)
    with pytest.raises(InputError, match="does not hold valid values") as error:
        read_run_metrics(str(path))
    assert error.value.where == str(path)


def test_numbers_beyond_all_bounds_are_read(tmp_path: Path) -> None:
    for value in (float("nan"), float("inf"), 1e308, -1.0):
        path = metrics_table(tmp_path / "m.parquet", value=value, total=value, weight=value)
        assert len(read_run_metrics(str(path)).logs) == 1


def test_damaged_metrics_do_not_stop_the_report(tmp_path: Path) -> None:
    entries = [{"id": name, "source": name, "status": "done"} for name in ("a", "b")]
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "logs": entries}))
    metrics_table(tmp_path / "metrics.parquet")
    with_rows, without = read_reported_run(str(tmp_path)).entries
    assert (list(with_rows.metrics), dict(without.metrics)) == (["ego.position_rmse_m"], {})
    (tmp_path / "metrics.parquet").write_bytes(b"PAR1")
    for damaged in read_reported_run(str(tmp_path)).entries:
        assert damaged.has_failed and "the metrics can't be read" in damaged.error["what"]


def test_an_empty_name_is_not_the_folder_where_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    metrics_table(tmp_path / "m.parquet")
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "logs": [{"id": "a"}]}))
    for read in (read_run_metrics, read_reported_run):
        assert read(".")
        with pytest.raises(InputError, match="the name of the run is empty"):
            read("")


def test_metrics_that_a_page_of_many_logs_does_not_show_are_not_held(tmp_path: Path) -> None:
    names = [f"log{k:03}" for k in range(MAX_LOGS_WITH_ALL_METRICS + 1)]
    entries = [{"id": name, "source": name, "status": "done"} for name in names]
    gates = {"gates": ["p95(lanes.*_share) < 1"]}
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 2, "pipeline": gates, "logs": entries}))
    metrics = ("ego.position_rmse_m", "ego.speed_rmse_mps", "lanes.found_share")
    rows = [(name, metric) for name in names for metric in metrics]
    one = parquet.read_table(metrics_table(tmp_path / "metrics.parquet"))
    columns = {field.name: one.column(field.name).to_pylist() * len(rows) for field in one.schema}
    columns |= {"log": [name for name, _ in rows], "metric": [metric for _, metric in rows]}
    parquet.write_table(pa.table(columns), tmp_path / "metrics.parquet", row_group_size=100)
    run = read_reported_run(str(tmp_path), lambda name: name == "ego.position_rmse_m")
    assert {tuple(entry.metrics) for entry in run.entries} == {("ego.position_rmse_m", "lanes.found_share")}
    assert {tuple(entry.metrics) for entry in read_reported_run(str(tmp_path)).entries} == {metrics}
