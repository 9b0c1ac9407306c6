"""The tables of `cwcli run -d`, read by the libraries that people read them with."""

from __future__ import annotations

from pathlib import Path

import duckdb
import pandas
import polars

from cwcli.fleet.names import safe_file_name
from tests.cli.test_fleet import HOSTILE, logs, reference

__all__ = ["logs", "reference"]  # fixtures


def test_metrics_are_one_table_for_duckdb_polars_and_pandas(reference: Path) -> None:
    pattern = f"{reference}/metrics/*/*.parquet"
    ids = {"a", "alone", "b", "log-2026", safe_file_name(HOSTILE.removesuffix(".mcap"))}
    relation = duckdb.sql(f"select * from read_parquet('{pattern}', hive_partitioning = true)")
    assert relation is not None
    by_duckdb = relation.df()
    by_polars = polars.read_parquet(f"{reference}/metrics/", hive_partitioning=True)
    by_pandas = pandas.read_parquet(reference / "metrics")
    columns = {"stage", "metric", "value", "unit", "n", "low", "high", "log"}
    for names in (by_duckdb.columns, by_polars.columns, by_pandas.columns):
        assert columns <= set(names)
    assert len(by_duckdb) == by_polars.height == len(by_pandas) > len(ids)
    for values in (by_duckdb["log"], by_polars["log"], by_pandas["log"].astype(str)):
        assert set(values) == ids
    assert str(by_duckdb["value"].dtype) == "float64"
