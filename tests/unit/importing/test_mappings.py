"""The mapping file of an import, given again as it is, makes the same channels to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cwcli.importing.mapping import read_mapping
from cwcli.importing.run import plan_import
from cwcli.importing.tables import Answers
from tests.unit.importing.other_base import OtherCase
from tests.unit.importing.real_tables import RealCase
from tests.unit.importing.test_other_files import CASES as OTHER_CASES
from tests.unit.importing.test_real_files import CASES as REAL_CASES

CASES: dict[str, RealCase | OtherCase] = {**REAL_CASES, **{f"other {name}": case for name, case in OTHER_CASES.items()}}
QUICK = {
    "clock_and_microseconds", "oxts_down", "midnight_clock", "nmea_degrees", "qgis_wkt", "u_blox_integers", "iphone",
    "other airdata", "other german", "other oxts", "other xsens", "turn_rates_of_the_other_sign", "rostopic_odometry",
}  # fmt: skip
"""Dates and clocks in columns of their own, pairs of places, units of their own, turned signs."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.long)
        for name, case in CASES.items()
        if not case.asks
    ],
)
def test_mapping_given_again_makes_the_same_channels(name: str, tmp_path: Path) -> None:
    files = [str(path) for path in CASES[name].make(tmp_path)]
    first = plan_import(files, Answers())
    (tmp_path / "again.toml").write_text(first.mapping_text())
    second = plan_import(files, read_mapping(str(tmp_path / "again.toml")))
    assert second.topics == first.topics
    for (_, one), (_, other) in zip(first.channels, second.channels, strict=True):
        for path, values in one.fields.items():
            if isinstance(values, np.ndarray):
                np.testing.assert_array_equal(other.fields[path], values, err_msg=f"{one.topic} {path}")
