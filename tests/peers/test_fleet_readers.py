"""The tables of `cwcli run -d`, read by the libraries that people read them with."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import duckdb
import pandas
import polars

from cwcli.fleet.names import safe_file_name
from tests.cli.test_fleet import HOSTILE, logs, reference

__all__ = ["logs", "reference"]  # fixtures


def test_metrics_are_one_table_for_duckdb_polars_and_pandas(reference: Path) -> None:
    file = reference / "metrics.parquet"
    ids = {"a", "alone", "b", "log-2026", safe_file_name(HOSTILE.removesuffix(".mcap"))}
    relation = duckdb.sql(f"select * from '{file}'")
    assert relation is not None
    by_duckdb = relation.df()
    by_polars = polars.read_parquet(file)
    by_pandas = pandas.read_parquet(file)
    columns = {"stage", "metric", "value", "unit", "n", "low", "high", "log", "run_id", "schema_version"}
    for names in (by_duckdb.columns, by_polars.columns, by_pandas.columns):
        assert columns <= set(names)
    assert len(by_duckdb) == by_polars.height == len(by_pandas) > len(ids)
    for values in (by_duckdb["log"], by_polars["log"], by_pandas["log"].astype(str)):
        assert set(values) == ids
    assert str(by_duckdb["value"].dtype) == "float64"


def test_views_hold_every_table(reference: Path) -> None:
    tables = json.loads((reference / "manifest.json").read_text())["tables"]
    with contextlib.chdir(reference), duckdb.connect() as database:
        database.execute((reference / "views.sql").read_text())
        for name in tables:
            folder, _, own = name.rpartition("/")
            view = f'{folder}."{own}"' if folder else own
            found = database.execute(f"select count(*), count(distinct run_id) from {view}").fetchone()
            assert found is not None and found[0] == pandas.read_parquet(reference / f"{name}.parquet").shape[0]
            assert found[1] <= 1
