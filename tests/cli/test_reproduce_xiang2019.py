"""`cwcli reproduce xiang2019`: its tables, its JSON, its metrics file, what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run


def test_every_number_stands_beside_the_paper_s(cwcli: Run, tmp_path: Path) -> None:
    done = cwcli("reproduce", "xiang2019", "--seeds", "20", "--json", "--metrics", "x.csv")
    assert done.returncode == 0, done.stderr.decode()
    document = json.loads(done.stdout)
    assert (document["paper"], document["seeds"], document["failed"]) == ("xiang2019", 20, [])
    sections = document["sections"]
    assert [row["range [m]"] for row in sections["figure_6"]] == [1.10, 3.20, 4.90, 9.30, 15.20]
    assert [row["paper UKF"] for row in sections["table_1"]] == [1.91, 5.31, 3.12, 3.14, 2.61, 5.14, 4.33, 5.74]
    assert [row["paper ms"] for row in sections["table_2"]] == [2.1, 5.9]
    assert len(sections["verdict"]) >= 5
    with (tmp_path / "x.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    ukf = [row for row in rows if (row["figure"], row["row"], row["quantity"]) == ("table_1", "line x", "ukf")]
    assert float(ukf[0]["value"]) == pytest.approx(sections["table_1"][0]["UKF"])


def test_fewer_seeds_give_the_same_numbers_again(cwcli: Run) -> None:
    one, two = (json.loads(cwcli("reproduce", "xiang2019", "--seeds", "4", "--json").stdout) for _ in range(2))
    for name in ("figure_6", "table_1", "where"):
        assert one["sections"][name] == two["sections"][name]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("xiang2018",), b"xiang2019"),
        (("xiang2019", "--seeds", "1"), b"--seeds"),
        (("xiang2019", "--plots", "a"), b"plots"),
    ],
)
def test_what_it_refuses(cwcli: Run, options: tuple[str, ...], said: bytes) -> None:
    done = cwcli("reproduce", *options)
    assert done.returncode == 2
    assert said in done.stderr
