"""A few cases, the findings of earlier ones, and that what must be found is found."""

from __future__ import annotations

import base64
import json
from collections import Counter
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from cwcli.errors import EXIT_BUG
from cwcli.importing.readers import ubx
from cwcli.logs.codecs.cdr import CdrDecoder
from cwcli.logs.read.reader import Log
from cwcli.logs.ros1.cdr_conversion import Ros1Converter
from cwcli.signals.columns import Columns, Field, Int64Array
from tests.fuzz import bag_cases, file_cases, import_cases, kernel_cases, osi_cases
from tests.fuzz.decoding import check_messages
from tests.fuzz.drive import drive
from tests.fuzz.import_cases import rows_of
from tests.fuzz.logs import joined, mutated_log, split
from tests.fuzz.messages import Messages
from tests.fuzz.worker import CASES
from tests.osi_traces import write_messages
from tests.unit.logs_read.builders import small_log
from tests.unit.logs_read.test_bags import bag

CORPUS = Path(__file__).parent / "corpus"
SEED = 17


def inputs_of(check: object, cases: range) -> Counter[str]:
    assert callable(check)
    counts: Counter[str] = Counter()
    for k in cases:
        counts.update(check(np.random.default_rng([SEED, k])))
    return counts


def test_a_few_messages() -> None:
    counts = inputs_of(kernel_cases.check_case, range(60))
    assert counts["inputs"] == 16 * 60 + 16  # one of them scans records of two kinds
    assert counts["compared"] > 100


def test_a_few_logs() -> None:
    counts = inputs_of(file_cases.check_case, range(15))
    assert counts["inputs"] == 4 * 15
    assert counts["compared"] > 10


def test_a_few_osi_traces() -> None:
    counts = inputs_of(osi_cases.check_case, range(10))
    assert counts["inputs"] == 4 * 10
    assert counts["accepted"] > 10


@pytest.mark.parametrize("level", [each for each in CASES if each not in {"kernel", "file", "osi"}])
def test_a_few_files_of_other_formats(level: str) -> None:
    module, _, name = CASES[level].partition(":")
    counts = inputs_of(getattr(import_module(f"tests.fuzz.{module}"), name), range(1 if level == "ros" else 8))
    assert counts["inputs"] >= 2
    assert counts["compared"] > 0


def test_a_wrong_value_of_an_import_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ubx, "NS_PER_S", 10**9 + 1)
    with pytest.raises(AssertionError, match="not a row of the file"):
        inputs_of(import_cases.check_ubx, range(2))


def test_a_missing_row_of_an_import_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(import_cases, "rows_of", lambda table: list(rows_of(table))[1:])
    with pytest.raises(AssertionError, match="1 rows are missing, 0 are counted"):
        inputs_of(import_cases.check_csv, range(2))


def test_a_wrong_value_of_a_bag_is_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(Ros1Converter, "convert", lambda self, data: b"\0\1\0\0" + data)
    with pytest.raises(AssertionError):
        bag_cases.check_bag(bag(tmp_path / "x.bag"), Counter())


def test_a_bug_on_an_osi_trace_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(osi_cases, "run_command_line", lambda arguments: EXIT_BUG)
    with pytest.raises(AssertionError):
        inputs_of(osi_cases.check_case, range(1))


def test_an_osi_trace_that_was_a_finding(tmp_path: Path) -> None:
    """A yaw rate of -1e300 rad/s in the second half made every covariance NaN: exit code 70."""
    messages = osi_cases.TRACES[0](20)
    for _, _, world in messages[10:]:
        world.moving_object[0].base.orientation_rate.yaw = -1e300
    counts: Counter[str] = Counter()
    data = write_messages(tmp_path / "in.mcap", messages).read_bytes()
    osi_cases.check_trace(data, ("estimate", "LOG", "-o", "OUT"), counts)
    assert counts["accepted"] == 1


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*.mcap")), ids=lambda path: path.stem)
def test_logs_that_were_findings(path: Path) -> None:
    file_cases.check_log(path.read_bytes(), ("info", "LOG", "--json"), Counter())


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*.json")), ids=lambda path: path.stem)
def test_messages_that_were_findings(path: Path) -> None:
    told = json.loads(path.read_text(encoding="utf-8"))
    payloads = tuple(map(base64.b64decode, told["payloads"]))
    schema = base64.b64decode(told["schema"])
    accepted, _ = check_messages(
        Messages(told["encoding"], told["schema_name"], schema, payloads, blobs=tuple(told["blobs"]))
    )
    assert accepted == told["accepted"]


@pytest.mark.parametrize("name", ["channel_cut_in_chunk", "channel_padded_in_chunk"])
def test_a_definition_of_another_length_costs_no_message(tmp_path: Path, name: str) -> None:
    """The official reader loses the messages behind it; the records' lengths tell of these."""
    data = (CORPUS / f"{name}.mcap").read_bytes()
    assert file_cases.loses_its_place(data)
    counts: Counter[str] = Counter()
    file_cases.check_log(data, None, counts)
    assert counts["compared"] == 1
    whole = small_log(30)
    assert not file_cases.loses_its_place(whole)
    (tmp_path / "whole.mcap").write_bytes(whole)
    assert file_cases.walked_rows(whole, tmp_path / "whole.mcap") == file_cases.official_rows(whole, seeking=False)


def test_a_wrong_value_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    finish = CdrDecoder.build_columns

    def wrong(decoder: CdrDecoder, rows: Int64Array) -> dict[str, Field]:
        fields = finish(decoder, rows)
        return {path: column + 1 if isinstance(column, np.ndarray) else column for path, column in fields.items()}

    monkeypatch.setattr(CdrDecoder, "build_columns", wrong)
    with pytest.raises(AssertionError):
        inputs_of(kernel_cases.check_case, range(30))


def test_a_lost_message_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = Log.columns

    def fewer(log: Log, topic: str) -> Columns:
        return columns(log, topic).slice_by_log_time(log.start_ns + 1, None)

    file_cases.check_log(small_log(10), None, Counter())
    monkeypatch.setattr(Log, "columns", fewer)
    with pytest.raises(AssertionError, match="/fix"):
        file_cases.check_log(small_log(10), None, Counter())


def test_an_undocumented_exit_code_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    command = ("info", "LOG", "--json")
    file_cases.check_log(small_log(10), command, Counter())
    monkeypatch.setattr(file_cases, "run_command_line", lambda arguments: EXIT_BUG)
    with pytest.raises(AssertionError):
        file_cases.check_log(small_log(10), command, Counter())


def test_a_process_that_dies_is_told(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="the worker ended with 1"):
        drive("kernel", SEED, n_cases=1, kernels=tmp_path)


def test_cases_follow_from_their_seed_and_number() -> None:
    one, two = (mutated_log(np.random.default_rng([SEED, 3]), small_log(10)) for _ in range(2))
    assert one == two
    assert one != small_log(10)


def test_split_records_join_again() -> None:
    data = small_log(10)
    assert joined(split(data[8:-8])) == data[8:-8]
