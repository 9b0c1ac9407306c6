"""The tables of a run: the same bytes for the same rows, in whatever order and by whomever they were computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cwcli.errors import InputError
from cwcli.fleet import rows_in_order, tables
from cwcli.fleet.staged_tables import list_staged_tables, write_staged_tables_file_of_log
from cwcli.fleet.table_schemas import columns_in_types_of_schema, unify_schemas
from cwcli.fleet.tables import MergedRows, StagedRows, are_tables_whole, write_tables
from cwcli.metrics.table import ColumnDoc, Table, TableColumn
from cwcli.signals.columns import Strings
from tests.cli.fleet_logs import tree

RUN_ID = "0123456789abcdef"
Logs = Mapping[str, Sequence[tuple[str, Table]]]


def table(**columns: TableColumn) -> Table:
    docs = {name: ColumnDoc(doc=f"the {name}") for name in columns}
    return Table("t", columns, docs, {"topic": "/t", "n": str(len(columns))})


def logs_of_one_schema(rng: np.random.Generator) -> Logs:
    """Nine logs of up to 40 rows, with text that repeats, lists and NaN."""
    logs = {}
    for k in range(9):
        n = int(rng.integers(0, 40))
        speed_mps = np.where(rng.random(n) < 0.2, np.nan, rng.normal(size=n))
        words = Strings(np.array(rng.integers(-1, 2, n), np.int32), ("left", f"right {k}"))
        found = table(speed_mps=speed_mps, word=words, pair=rng.normal(size=(n, 2)), n=np.arange(n))
        logs[f"log{k}"] = [("metrics", found), ("details/events", table(at_s=np.arange(2.0)))]
    return logs


def logs_of_many_schemas(rng: np.random.Generator) -> Logs:
    """Logs that lack columns, and whose columns have other types."""
    n = 3
    columns: list[dict[str, TableColumn]] = [
        {"z": np.arange(n), "x": np.arange(n) / 2.0},
        {"z": np.arange(n, dtype=np.int8)},
        {"x": np.arange(n), "a": ["1", None, "b"]},
        {"a": np.arange(n), "b": rng.normal(size=(n, 2))},
        {"b": rng.normal(size=(n, 3)), "z": np.arange(n) / 3.0},
    ]
    return {f"log{k}": [("tables/odd", table(**each))] for k, each in enumerate(columns)}


def stage(out: Path, logs: Logs) -> None:
    for id, own in logs.items():
        (out / "logs" / id).mkdir(parents=True)
        write_staged_tables_file_of_log(own, out / "logs" / id / "tables.arrows")


def staged_rows(out: Path) -> StagedRows:
    return StagedRows(lambda id: out / "logs" / id / "tables.arrows")


def content(out: Path) -> dict[str, str]:
    return {name: digest for name, digest in tree(out).items() if not name.startswith("logs/")}


@pytest.mark.parametrize("make_logs", [logs_of_one_schema, logs_of_many_schemas])
@pytest.mark.parametrize("seed", range(4))
def test_shards_merged_equal_one_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int, make_logs: object
) -> None:
    monkeypatch.setattr(tables, "ROWS_PER_ROW_GROUP", 16)
    monkeypatch.setattr(tables, "ROWS_PER_ROW_GROUP_WITH_LISTS", 7)
    monkeypatch.setattr(tables, "MAX_OPEN_TABLE_FILES", 4)  # the tables are written in several passes
    rng = np.random.default_rng(seed)
    logs: Logs = make_logs(rng)  # type: ignore[operator]
    whole = tmp_path / "whole"
    stage(whole, logs)
    rows = staged_rows(whole)
    names = write_tables(whole, dict.fromkeys(logs, rows), RUN_ID)
    assert names == sorted({name for own in logs.values() for name, _ in own})
    monkeypatch.setattr(rows_in_order, "ROWS_PER_READ", 5)  # how rows are read and joined on the way does not show
    monkeypatch.setattr(tables, "PIECES_PER_JOINED_BLOCK", 2)
    monkeypatch.setattr(tables, "MAX_OPEN_FOOTER_BYTES", 4_000)
    monkeypatch.setattr(rows_in_order, "MAX_OPEN_FOOTER_BYTES", 4_000)
    shard_of = {id: int(rng.integers(3)) for id in logs}
    merged: dict[str, MergedRows] = {}
    for k in range(3):
        own = {id: each for id, each in logs.items() if shard_of[id] == k}
        (tmp_path / f"s{k}").mkdir()
        stage(tmp_path / f"s{k}", own)
        write_tables(tmp_path / f"s{k}", dict.fromkeys(own, staged_rows(tmp_path / f"s{k}")), RUN_ID)
        merged |= dict.fromkeys(own, MergedRows(tmp_path / f"s{k}"))
    (tmp_path / "merged").mkdir()
    assert write_tables(tmp_path / "merged", merged, RUN_ID) == names
    assert content(tmp_path / "merged") == content(whole)


def test_memory_does_not_hold_a_piece_of_every_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A piece takes some kB however few its rows, so pieces are joined: of 60 logs at most 4 pieces and 15 blocks."""
    monkeypatch.setattr(tables, "PIECES_PER_JOINED_BLOCK", 4)
    logs: Logs = {f"log{k:02}": [("metrics", table(at_s=np.array([float(k)])))] for k in range(60)}
    stage(tmp_path, logs)
    held: list[int] = []
    add = tables._TableWriter.append_piece

    def add_and_count(self: tables._TableWriter, piece: rows_in_order.RowsPiece) -> None:
        add(self, piece)
        held.append(len(self._pieces) + len(self._pending))

    monkeypatch.setattr(tables._TableWriter, "append_piece", add_and_count)
    write_tables(tmp_path, dict.fromkeys(logs, staged_rows(tmp_path)), RUN_ID)
    assert len(held) == 60
    assert max(held) <= 4 + 60 / 4
    assert pq.read_table(tmp_path / "metrics.parquet")["at_s"].to_pylist() == [float(k) for k in range(60)]


def test_footers_are_bounded_by_the_size_of_each_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shards whose footers are an eighth of their files at most merge, however many they are; others are named."""
    shards = {f"drive{k}": MergedRows(tmp_path / f"drive{k}") for k in range(4)}
    for id, rows in shards.items():
        stage(tmp_path / id, {id: [("metrics", table(x=np.random.default_rng(1).normal(size=9000)))]})
        write_tables(tmp_path / id, {id: staged_rows(tmp_path / id)}, RUN_ID)
        size = pq.read_metadata(tmp_path / id / "metrics.parquet").serialized_size
        assert rows.count_footer_bytes("metrics") == size and rows.count_footer_bytes("no") == 0
    monkeypatch.setattr(tables, "MIN_FOOTER_BYTES_OF_TABLE", 0)
    (tmp_path / "out").mkdir()
    write_tables(tmp_path / "out", shards, RUN_ID)
    merged = tree(tmp_path / "out")
    (tmp_path / "drive3" / "details").mkdir()
    few = tmp_path / "drive3" / "details" / "few.parquet"
    pq.write_table(pa.table({"log": ["drive3"], "x": [1.0]}), few)
    with pytest.raises(InputError, match="the list of its row groups takes") as refused:
        write_tables(tmp_path / "out", shards, RUN_ID)
    assert refused.value.where == str(few) and "row groups" in (refused.value.hint or "")
    assert tree(tmp_path / "out") == merged


@pytest.mark.parametrize(
    ("n_logs_of_folder", "n_open_footers", "n_open_files", "n_most"),
    [(1, 6, 6, 1), (3, 6, 6, 6), (3, 2, 6, 2), (3, 0, 6, 1), (3, 6, 2, 2)],
    ids=["one log each", "logs that alternate", "room for two", "room for less than one", "two files"],
)
def test_tables_are_open_only_where_their_rows_are_read(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    n_logs_of_folder: int,
    n_open_footers: int,
    n_open_files: int,
    n_most: int,
) -> None:
    """Six folders, with the logs of shards: the first has log 0, log 6 and log 12, the second log 1 and so on."""
    monkeypatch.setattr(tables, "ROWS_PER_ROW_GROUP", 16)
    monkeypatch.setattr(rows_in_order, "ROWS_PER_READ", 5)
    monkeypatch.setattr(rows_in_order, "MAX_OPEN_READ_TABLES", n_open_files)
    logs: Logs = {f"log{k:02}": [("metrics", table(x=np.arange(9 + k)))] for k in range(6 * n_logs_of_folder)}
    source_of_log: dict[str, MergedRows] = {}
    for k in range(6):
        out = tmp_path / f"shard{k}"
        own = {id: logs[id] for id in list(logs)[k::6]}
        stage(out, own)
        write_tables(out, dict.fromkeys(own, staged_rows(out)), RUN_ID)
        source_of_log |= dict.fromkeys(own, MergedRows(out))
    n_bytes = max(each.count_footer_bytes("metrics") for each in source_of_log.values())
    for module in (tables, rows_in_order):
        monkeypatch.setattr(module, "MAX_OPEN_FOOTER_BYTES", n_open_footers * n_bytes)
    open_files: set[pq.ParquetFile] = set()
    counts: list[int] = []

    class CountedFile(pq.ParquetFile):
        def __enter__(self) -> CountedFile:
            open_files.add(self)
            counts.append(len(open_files))
            return self

        def __exit__(self, *error: object) -> None:
            open_files.discard(self)
            super().__exit__(*error)

    monkeypatch.setattr(pq, "ParquetFile", CountedFile)
    write_tables(tmp_path / "merged", source_of_log, RUN_ID)
    assert max(counts) == n_most and not open_files
    found = pq.read_table(tmp_path / "merged" / "metrics.parquet", columns=["log", "x"]).to_pydict()
    assert found["log"] == [id for k, id in enumerate(logs) for _ in range(9 + k)]
    assert found["x"] == [x for k in range(len(logs)) for x in range(9 + k)]


@pytest.mark.parametrize("n_bytes", [-40, -1, 11, 5, 0])
def test_table_that_was_cut_is_called_no_table(tmp_path: Path, n_bytes: int) -> None:
    stage(tmp_path / "a", {"a": [("metrics", table(x=np.arange(3)))]})
    write_tables(tmp_path / "a", {"a": staged_rows(tmp_path / "a")}, RUN_ID)
    path = tmp_path / "a" / "metrics.parquet"
    path.write_bytes(path.read_bytes()[:n_bytes])
    with pytest.raises(InputError, match="the table can't be read: Parquet") as refused:
        write_tables(tmp_path, {"a": MergedRows(tmp_path / "a")}, RUN_ID)
    assert refused.value.where == str(path)


@pytest.mark.parametrize("logs", [[None, "a"], ["a", None], [1, 2]])
def test_table_of_logs_without_ids_is_refused(tmp_path: Path, logs: list[str | int | None]) -> None:
    pq.write_table(pa.table({"log": logs, "x": [1.0, 2.0]}), tmp_path / "metrics.parquet")
    with pytest.raises(InputError, match="an entry of its column log is no text") as refused:
        write_tables(tmp_path / "out", {"a": MergedRows(tmp_path)}, RUN_ID)
    assert refused.value.where == str(tmp_path / "metrics.parquet")


def test_table_that_changes_between_two_openings_is_told(tmp_path: Path) -> None:
    path = tmp_path / "metrics.parquet"
    pq.write_table(pa.table({"log": ["a", "b"], "x": [1.0, 2.0]}), path)
    reader, opened = rows_in_order.RowsInOrder(path, 0), rows_in_order.OpenTables()
    assert [piece.n for piece in reader.iter_rows_of_log("a", opened)] == [1]
    reader.close()
    pq.write_table(pa.table({"log": ["b", "b", "b"], "x": [1.0, 2.0, 3.0]}), path)
    with pytest.raises(InputError, match="the table changed while it was merged"):
        list(reader.iter_rows_of_log("b", opened))


def test_new_rows_replace_those_of_the_same_log_and_others_stay(tmp_path: Path) -> None:
    logs = logs_of_one_schema(np.random.default_rng(1))
    changed = {**logs, "log3": logs["log4"]}
    for name, each in (("a", logs), ("b", changed)):
        stage(tmp_path / name, each)
        write_tables(tmp_path / name, dict.fromkeys(each, staged_rows(tmp_path / name)), RUN_ID)
    stage(tmp_path / "new", {"log3": changed["log3"]})
    old, new = MergedRows(tmp_path / "a"), staged_rows(tmp_path / "new")
    write_tables(tmp_path / "a", {id: new if id == "log3" else old for id in logs}, RUN_ID)
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_columns_tell_log_run_and_version_and_keep_their_descriptions(tmp_path: Path) -> None:
    stage(
        tmp_path,
        {"b": [("metrics", table(speed_mps=np.array([1.0])))], "a": [("metrics", table(speed_mps=np.array([2.0])))]},
    )
    write_tables(tmp_path, dict.fromkeys(("b", "a"), staged_rows(tmp_path)), RUN_ID)
    found = pq.read_table(tmp_path / "metrics.parquet")
    assert found.to_pylist() == [
        {"log": "a", "speed_mps": 2.0, "run_id": RUN_ID, "schema_version": 1},
        {"log": "b", "speed_mps": 1.0, "run_id": RUN_ID, "schema_version": 1},
    ]
    assert found.schema.field("speed_mps").metadata == {b"unit": b"m/s", b"doc": b"the speed_mps"}
    assert {b"name": b"t", b"topic": b"/t", b"run_id": RUN_ID.encode()}.items() <= found.schema.metadata.items()


def test_types_that_have_nothing_in_common_become_text() -> None:
    schemas = [pa.schema([("a", kind)]) for kind in (pa.int8(), pa.int64(), pa.string())]
    assert unify_schemas(schemas[:2]).field("a").type == pa.int64()
    assert unify_schemas(schemas).field("a").type == pa.string()
    assert unify_schemas([pa.schema([("b", pa.int8())]), pa.schema([("a", pa.int8())])]).names == ["a", "b"]


@pytest.mark.parametrize("damage", [b"", b"half", b"\0" * 40 + (10**9).to_bytes(8, "little") + b"CWTABLE1"])
def test_damaged_tables_of_a_log_are_refused(tmp_path: Path, damage: bytes) -> None:
    (tmp_path / "tables.arrows").write_bytes(damage)
    with pytest.raises(InputError, match="can't be read"):
        list_staged_tables(tmp_path / "tables.arrows")


def test_tables_that_were_cut_are_not_whole(tmp_path: Path) -> None:
    stage(tmp_path, {"a": [("metrics", table(x=np.arange(3)))]})
    names = write_tables(tmp_path, {"a": staged_rows(tmp_path)}, RUN_ID)
    assert are_tables_whole(tmp_path, names) and are_tables_whole(tmp_path, [])
    assert not are_tables_whole(tmp_path, [*names, "details/none"]) and not are_tables_whole(tmp_path, None)
    path = tmp_path / "metrics.parquet"
    path.write_bytes(path.read_bytes()[:-1])
    assert not are_tables_whole(tmp_path, names)


@pytest.mark.parametrize("rows_with_null", [False, True])
def test_list_of_fixed_size_that_a_log_lacks_or_that_is_null_is_read_again(
    tmp_path: Path, *, rows_with_null: bool
) -> None:
    """Arrow before 26 does not read its own Parquet files where a list of fixed size is null."""
    pairs = [[1.0, 2.0], None if rows_with_null else [5.0, 6.0], [3.0, 4.0]]
    with_pairs = pa.table({"n": [0, 1, 2], "pair": pa.array(pairs, pa.list_(pa.float64(), 2))})
    without = pa.table({"n": [3]})
    schema = unify_schemas([with_pairs.schema, without.schema])
    assert schema.field("pair").type == pa.list_(pa.field("element", pa.float64()))
    joined = pa.concat_tables(
        pa.table(columns_in_types_of_schema(each, schema), schema=schema) for each in (with_pairs, without)
    )
    pq.write_table(joined, tmp_path / "t.parquet")
    again = pq.read_table(tmp_path / "t.parquet")
    assert again["pair"].to_pylist() == [*pairs, None]
    assert again.schema.equals(schema)
    assert unify_schemas([again.schema, with_pairs.schema]).field("pair").type == schema.field("pair").type
