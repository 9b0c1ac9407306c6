"""The recipes of a stage and of a channel, on a bundled log."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pyarrow import parquet

from cwcli.logs.read.reader import Log
from tests.recipes.conftest import Built
from tests.recipes.house import SAMPLES, House

INTERSECTION = SAMPLES / "intersection.mcap"
CURVE = SAMPLES / "curve.mcap"


def compiled(house: House) -> None:
    """Compile the schemas, as both recipes say."""
    house.python("-m", "tools.compile_schemas")


def shows(house: House, topic: str) -> bool:
    """Whether a panel of the viewer layout has the topic."""
    panels = json.loads(house.run("layout"))["configById"]
    return any(topic in json.dumps(settings) for settings in panels.values())


def test_a_stage_runs_is_judged_and_stands_in_info_config_help_docs_and_layout(built: Built) -> None:
    house = built("A stage")
    compiled(house)
    arguments = ("--stage", "estimate,comfort", "--comfort-limit", "1.5", "--json")
    told = json.loads(house.run("run", CURVE, "-o", "out.mcap", "--metrics-dir", "m", *arguments))["stages"]["comfort"]
    (counts,), (errors,) = told["sections"]["comfort"], told["sections"]["errors"]
    with Log.open(house.folder / "out.mcap") as log:
        columns = log.columns("/cwcli/ego/comfort")
        lateral_mps2 = np.asarray(columns.fields["lateral_accel_mps2"])
        assert "cwcli.run.comfort" in dict(log.metadata)
    assert np.abs(lateral_mps2).max() == pytest.approx(2.5, abs=0.1)  # 10 m/s in a bend of 40 m
    assert counts == {"states": len(columns), "strong": int(np.count_nonzero(np.abs(lateral_mps2) > 1.5))}
    assert 0.0 < errors["rms_mps2"] < 0.1
    assert (house.folder / "m" / "comfort.parquet").is_file()
    assert json.loads(house.run("info", CURVE, "--json"))["commands"]["comfort"]["after"] == ["estimate"]
    house.run("comfort", "out.mcap", "-o", "again.mcap", "--replace", "--limit", "3", "--metrics", "c.csv")
    assert "comfort       Show how strongly the ego turns." in house.run("--help")
    assert "--comfort-limit MPS2" in house.run("run", "--help")
    assert "[comfort]\nlimit = 1.0\n" in house.run("config", CWCLI_COMFORT_LIMIT="1")
    docs = house.write_docs()
    assert "## cwcli comfort\n" in docs
    assert "| `/cwcli/ego/comfort` | `cwcli.v1.Comfort` | `comfort` |  | how strongly the ego turns |" in docs
    assert "| `lateral_accel_mps2` | double | m/s^2 | To the left. |" in docs
    assert shows(house, "/cwcli/ego/comfort")
    house.run("run", SAMPLES / "*.mcap", "-d", "many", "--stage", "estimate,comfort", "--quiet")
    table = parquet.read_table(house.folder / "many" / "details" / "comfort.parquet")
    assert set(table["log"].to_pylist()) == {path.stem for path in SAMPLES.glob("*.mcap")}
    house.obeys_its_laws()


def test_a_channel_is_written_read_back_bound_and_stands_in_docs_and_layout(built: Built) -> None:
    house = built("A channel")
    compiled(house)
    house.run("run", INTERSECTION, "-o", "out.mcap")
    with Log.open(house.folder / "out.mcap") as log:
        way_m = np.asarray(log.columns("/cwcli/ego/odometer").fields["way_m"])
    assert (way_m[0], way_m[-1]) == (0.0, pytest.approx(90.0, abs=1.0))  # ten seconds at 9 m/s
    channels = json.loads(house.run("info", "out.mcap", "--json"))["channels"]
    assert [each["roles"] for each in channels if each["topic"] == "/cwcli/ego/odometer"] == [["odometer"]]
    docs = house.write_docs()
    assert (
        "| `/cwcli/ego/odometer` | `cwcli.v1.Odometer` | `estimate` | `odometer` | how far the ego has driven |" in docs
    )
    assert shows(house, "/cwcli/ego/odometer")
    house.obeys_its_laws()
