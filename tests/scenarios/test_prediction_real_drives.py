"""The default predictor on the development logs in ../shared/logs, by the stages, from causal states.

The command of docs/prediction.md: `cwcli estimate --causal LOG -o - | cwcli predict -`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cwcli.estimation.config import EstimatorConfig
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import run_stage
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.signals.vehicle_state import EGO_ID
from cwcli.stages import STAGES
from cwcli.stages.estimate import EstimateConfig, estimate
from cwcli.stages.predict import PredictConfig

LOGS = Path(__file__).parents[2].parent / "shared" / "logs"
BASELINE = "cv"
HORIZONS_S = (1.0, 2.5, 5.0)
Row = dict[str, Any]


@pytest.fixture(
    scope="module",
    params=[
        "balzer-dresden-2014-03-26.ros2",
        "psu-follow-2obu",
        "openacc-dynamic-part22.ros2",
        "openacc-dynamic-part23.ros2",
    ],
    ids=["dresden", "two-cars", "platoon-22", "platoon-23"],
)
def records(request: pytest.FixtureRequest) -> list[Row]:
    """Errors up to 5 s ahead, one record per vehicle, model and horizon."""
    path = LOGS / f"{request.param}.mcap"
    if not path.exists():
        pytest.skip("the development logs in ../shared/logs are not here")
    with Log.open(path) as log:
        states = estimate(log, EstimateConfig(estimator=EstimatorConfig(causal=True)))
        result = run_stage(
            STAGES["predict"], log.with_channels(states.channels), PredictConfig(horizon_s=HORIZONS_S[-1])
        )
    return list(result.tables["prediction"].rows_as_dicts())


def groups(records: list[Row], model: str, horizon_s: float) -> dict[str, list[Row]]:
    """The ego's record, and those of all remote vehicles together, with at least one known outcome."""
    own = [r for r in records if r["model"] == model and int(r["n"]) > 0 and r["horizon_s"] == horizon_s]
    found = {
        "ego": [row for row in own if row["vehicle"] == EGO_ID],
        "remote": [row for row in own if row["vehicle"] != EGO_ID],
    }
    return {name: rows for name, rows in found.items() if rows}


def pooled(rows: list[Row], name: str) -> float:
    n = sum(int(row["n"]) for row in rows)
    return sum(float(row[name]) * int(row["n"]) for row in rows) / n


@pytest.mark.parametrize("horizon_s", HORIZONS_S)
def test_default_is_not_worse_than_constant_velocity(records: list[Row], horizon_s: float) -> None:
    ours, baseline = groups(records, DEFAULT_MODEL, horizon_s), groups(records, BASELINE, horizon_s)
    assert set(ours) == set(baseline) >= {"ego"}
    for name, rows in ours.items():
        assert pooled(rows, "mean_m") <= pooled(baseline[name], "mean_m"), name


@pytest.mark.parametrize("horizon_s", HORIZONS_S)
def test_ninety_per_cent_ellipse_holds_ninety_per_cent(records: list[Row], horizon_s: float) -> None:
    for name, rows in groups(records, DEFAULT_MODEL, horizon_s).items():
        # 98.7 % on Dresden at 1 s, where most is the position at the start: its errors last, so this track has them too
        assert 0.80 <= pooled(rows, "inside_90") <= 0.99, name


@pytest.mark.parametrize("horizon_s", HORIZONS_S)
def test_most_starts_have_an_outcome(records: list[Row], horizon_s: float) -> None:
    """What the shares are made of: no group of a handful."""
    for rows in groups(records, DEFAULT_MODEL, horizon_s).values():
        assert sum(int(row["n"]) for row in rows) > 300
