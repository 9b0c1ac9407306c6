"""Metrics tables, read back with pyarrow and the csv module."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cwcli.errors import OutputError, UsageError
from cwcli.metrics.table import ColumnDoc, Table, check_table_file_name, to_arrow_table, unit_of_column, write_table
from cwcli.signals.columns import Ragged, Strings


def example() -> Table:
    return Table(
        "warnings",
        {
            "stamp_ns": np.array([1, 2, 2**62]),
            "speed_mps": np.array([1.5, np.nan, 0.1 + 0.2]),
            "other_id": Strings(np.array([1, -1, 0], np.int32), ("a", 'b,"c"')),
            "rule": ["ttc", None, "song2016"],
            "is_true": np.array([True, False, True]),
            "position": np.array([[1.0, 2.0], [3.0, 4.0], [5.0, np.nan]]),
            "lead": Ragged(np.array([1.0, 2.0, 3.0]), np.array([0, 2, 2, 3])),
        },
        docs={"position": ColumnDoc(unit="m", frame="map", doc="Where it was")},
        metadata={"version": "1"},
    )


def test_parquet_round_trip(tmp_path: Path) -> None:
    write_table(example(), tmp_path / "t.parquet")
    table = pq.read_table(tmp_path / "t.parquet")
    assert table["stamp_ns"].to_pylist() == [1, 2, 2**62]
    assert np.array_equal(table["speed_mps"].to_numpy(), [1.5, np.nan, 0.1 + 0.2], equal_nan=True)
    assert table["other_id"].to_pylist() == ['b,"c"', None, "a"]
    assert table["rule"].to_pylist() == ["ttc", None, "song2016"]
    assert table["is_true"].to_pylist() == [True, False, True]
    assert table["position"].to_pylist()[:2] == [[1.0, 2.0], [3.0, 4.0]]
    assert table["lead"].to_pylist() == [[1.0, 2.0], [], [3.0]]
    assert table.schema.metadata[b"version"] == b"1"
    assert table.schema.metadata[b"name"] == b"warnings"


def test_fields_carry_unit_frame_and_doc() -> None:
    schema = to_arrow_table(example()).schema
    assert schema.field("speed_mps").metadata == {b"unit": b"m/s"}
    assert schema.field("stamp_ns").metadata == {b"unit": b"ns"}
    assert schema.field("position").metadata == {b"unit": b"m", b"frame": b"map", b"doc": b"Where it was"}
    assert not schema.field("rule").metadata


def test_csv_round_trip(tmp_path: Path) -> None:
    write_table(example(), tmp_path / "t.CSV")
    with (tmp_path / "t.CSV").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "stamp_ns", "speed_mps", "other_id", "rule", "is_true", "position_0", "position_1", "lead",
    ]  # fmt: skip
    assert [row["speed_mps"] for row in rows] == ["1.5", "", "0.30000000000000004"]
    assert [row["other_id"] for row in rows] == ['b,"c"', "", "a"]
    assert [row["position_1"] for row in rows] == ["2", "4", ""]
    assert [row["lead"] for row in rows] == ["1.0 2.0", "", "3.0"]
    assert rows[2]["stamp_ns"] == str(2**62)


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_empty_table(tmp_path: Path, suffix: str) -> None:
    table = Table("empty", {"x_m": np.zeros(0), "id": Strings(np.zeros(0, np.int32), ()), "rule": []})
    write_table(table, tmp_path / f"t{suffix}")
    assert len(table) == 0
    if suffix == ".parquet":
        assert pq.read_table(tmp_path / "t.parquet").schema.field("rule").type == pa.string()
    else:
        assert (tmp_path / "t.csv").read_text() == '"x_m","id","rule"\n'


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_same_table_gives_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    for name in "ab":
        write_table(example(), tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_a_dictionary_holds_each_value_once() -> None:
    """Behind a dictionary with equal values Arrow writes memory as it finds it: files of equal tables differed."""
    twice = Strings(np.array([2, 0, -1, 1, 0], np.int32), ("/imu", "/gps", "/imu"))
    column = to_arrow_table(Table("t", {"topic": twice}))["topic"].combine_chunks()
    assert column.dictionary.to_pylist() == ["/imu", "/gps"]
    assert column.to_pylist() == ["/imu", "/imu", None, "/gps", "/imu"]


def test_sliced_columns_are_written_right(tmp_path: Path) -> None:
    """Views with strides, as stages cut them out of larger arrays."""
    states = np.arange(24.0).reshape(6, 4)
    table = Table("t", {"x_m": states[::2, 1], "pair": states[::2, 2:]})
    write_table(table, tmp_path / "t.parquet")
    found = pq.read_table(tmp_path / "t.parquet").to_pydict()
    assert found == {"x_m": [1.0, 9.0, 17.0], "pair": [[2.0, 3.0], [10.0, 11.0], [18.0, 19.0]]}


@pytest.mark.parametrize("name", ["t.json", "t", "t.parquet.txt"])
def test_unknown_suffix_is_a_usage_error(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="Parquet or CSV"):
        check_table_file_name(tmp_path / name)


def test_existing_table_needs_force(tmp_path: Path) -> None:
    write_table(example(), tmp_path / "t.csv")
    with pytest.raises(OutputError, match="the file exists"):
        write_table(example(), tmp_path / "t.csv")
    write_table(example(), tmp_path / "t.csv", force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"]


def test_missing_folder_is_an_output_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"):
        write_table(example(), tmp_path / "no" / "t.parquet")


@pytest.mark.parametrize(
    ("columns", "docs", "words"),
    [
        ({"a": np.zeros(2), "b": np.zeros(3)}, {}, "differ in length"),
        ({"a": np.zeros(2)}, {"b": ColumnDoc()}, "not there"),
    ],
)
def test_inconsistent_tables_are_refused(
    columns: dict[str, np.ndarray], docs: dict[str, ColumnDoc], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        Table("t", columns, docs)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("speed_mps", "m/s"),
        ("yaw_accel_radps2", "rad/s^2"),
        ("curvature_1pm", "1/m"),
        ("event_id", ""),
        ("m", ""),
        ("latitude_deg", "deg"),
    ],
)
def test_unit_follows_from_the_name(name: str, unit: str) -> None:
    assert unit_of_column(name) == unit
