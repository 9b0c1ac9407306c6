"""Stage `predict`: states in, predicted paths and their errors out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from cwcli.channels.binding import bind
from cwcli.channels.path_scene import write_path_scene
from cwcli.channels.predicted_path import PredictedPaths, write_paths
from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_PATH, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, read_states, require_ego
from cwcli.logs.read.reader import Log
from cwcli.metrics.table import Table, TableColumn
from cwcli.option import Option
from cwcli.pipeline.result import Cell, InputCount, Section, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.prediction.calibrate import predict_vehicles
from cwcli.prediction.horizon import BASELINE, compare_models, horizon_table
from cwcli.prediction.models import DEFAULT_MODEL, MODELS
from cwcli.prediction.rollout import Discretisation, check_request
from cwcli.signals.columns import OutputChannel
from cwcli.signals.rows import tracks_of
from cwcli.signals.vehicle_state import EGO_ID

EXAMPLES = (
    "cwcli predict estimated.mcap -o predicted.mcap --horizon 3",
    "cwcli estimate drive.mcap -o - | cwcli predict - -o predicted.mcap",
)
ERROR_HORIZONS_S = (0.5, 1.0, 1.5, 2.0, 2.5)
MAX_MESSAGE_AGE_S = 1.0
"""How much longer than the horizon a remote path is: its state is older than the moment at which it is used."""
MAX_GAP_S = 0.5


@dataclass(frozen=True)
class PredictConfig:
    """Settings of the stage.

    Attributes:
        model: A key of `prediction.MODELS`.
        horizon_s, step_s: Of the published paths; remote paths reach `MAX_MESSAGE_AGE_S` further.
        discretisation: "exact", or "paper" for song2016's recursion.
        topics: Role -> topic, the user's choices.
        start_ns, end_ns: Only states logged in this span are used.
    """

    model: Annotated[str, Option("--model", "{choices}", metavar="NAME", choices="cwcli.prediction.models:MODELS")] = (
        DEFAULT_MODEL
    )
    horizon_s: Annotated[float, Option("--horizon", "How far ahead.", metavar="SECONDS")] = 2.5
    step_s: Annotated[float, Option("--step", "Between the points of a path.", metavar="SECONDS")] = 0.05
    discretisation: Annotated[
        Discretisation,
        Option("--discretisation", "Integrate exactly, or by the recursion of song2016 (eq. 2, 9, 10)."),
    ] = "exact"
    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: An unknown model, or a horizon or step that is not positive.
        """
        check_request(self.model, self.discretisation, self.horizon_s, self.step_s)


def predict(log: Log, config: PredictConfig) -> StageResult:
    """Predict the path of every vehicle from each of its states.

    Needs the channels of `cwcli estimate`. Adds one path per state, with its covariance, and compares every motion
    model with what then happened.

    Raises:
        MissingSignalError: The log has no ego state.
    """
    bound = bind(
        log.channels,
        config.topics,
        required=(EGO_STATE.role,),
        optional=(REMOTE_STATE.role,),
        where=log.name,
        command="predict",
    )
    topics = {role: bindings[0].topic for role, bindings in bound.by_role.items()}
    columns = log.load(dict.fromkeys(topics.values()))
    channels: list[OutputChannel] = []
    predicted: list[PredictedPaths] = []
    errors: list[dict[str, Any]] = []
    inputs: list[InputCount] = []
    for role, path_channel, extra_s in (
        (EGO_STATE.role, EGO_PATH, 0.0),
        (REMOTE_STATE.role, REMOTE_PATH, MAX_MESSAGE_AGE_S),
    ):
        if role not in topics:
            continue
        everything = read_states(columns[topics[role]])
        states = everything.logged_within(config.start_ns, config.end_ns)
        if role == EGO_STATE.role:
            require_ego(states, log_name=log.name, topic=topics[role])
        inputs.append(InputCount(topics[role], role, len(everything), len(states)))
        paths = predict_vehicles(
            config.model,
            states.ids.codes,
            states.stamp_ns,
            states.state,
            states.covariance,
            horizon_s=config.horizon_s + extra_s,
            step_s=config.step_s,
            discretisation=config.discretisation,
        )
        predicted.append(PredictedPaths.of(states, config.model, paths))
        channels.append(write_paths(path_channel, predicted[-1]))
        errors.extend(_errors(states, config))
    channels.append(write_path_scene(predicted))
    table = _table(errors)
    summary = Summary(
        title="predict",
        sections=(_section(errors, config.horizon_s),),
        inputs=tuple(inputs),
        notes=bound.notes,
    )
    return StageResult(
        "predict", tuple(channels), {"prediction": table}, summary, run_record("predict", log, config, summary)
    )


def prediction_table(states: Sequence[VehicleStates], config: PredictConfig) -> Table:
    """The table `prediction`: a row per vehicle, motion model and horizon, of the vehicles of every channel."""
    return _table([record for each in states for record in _errors(each, config)])


def error_horizons(horizon_s: float) -> list[float]:
    """Where errors are told: every half second up to the horizon, and the horizon itself."""
    horizons = [h for h in ERROR_HORIZONS_S if h <= horizon_s + 1e-9]
    if not horizons or abs(horizons[-1] - horizon_s) > 1e-9:
        horizons.append(horizon_s)
    return horizons


def _errors(states: VehicleStates, config: PredictConfig) -> list[dict[str, Any]]:
    """One record per vehicle, model and horizon: every model from the same starts, against the vehicle's own track."""
    horizons = error_horizons(config.horizon_s)
    records = []
    for vehicle, rows in tracks_of(states.ids, states.stamp_ns):
        stamp_ns = states.stamp_ns[rows]
        compared = compare_models(
            list(MODELS),
            states.state[rows],
            states.covariance[rows],
            stamp_ns,
            stamp_ns,
            states.state[rows, :2],
            horizons_s=horizons,
            step_s=config.step_s,
            max_gap_s=MAX_GAP_S,
            discretisation=config.discretisation,
        )
        columns = horizon_table(compared)
        for i in range(len(columns["model"])):
            record: dict[str, Any] = {name: values[i] for name, values in columns.items()}
            records.append({"vehicle": vehicle, **record})
    return records


def _table(records: list[dict[str, Any]]) -> Table:
    names = list(records[0]) if records else ["vehicle", "model", "horizon_s", "n"]
    columns: dict[str, TableColumn] = {}
    for name in names:
        values = [record[name] for record in records]
        columns[name] = values if name in {"vehicle", "model"} else np.array(values)
    return Table("prediction", columns)


def _section(records: list[dict[str, Any]], horizon_s: float) -> Section:
    """Errors at the horizon: each model, for the ego and for all remote vehicles together."""
    rows: list[tuple[Cell, ...]] = []
    for group, is_member in (("ego", True), ("remote", False)):
        chosen = [
            r for r in records if (r["vehicle"] == EGO_ID) == is_member and abs(r["horizon_s"] - horizon_s) < 1e-9
        ]
        baseline = _pooled([r for r in chosen if r["model"] == BASELINE], "mean_m")
        for model in dict.fromkeys(r["model"] for r in chosen):
            own = [r for r in chosen if r["model"] == model and r["n"] > 0]
            if not own:
                continue
            mean = _pooled(own, "mean_m")
            rows.append(
                (
                    group,
                    model,
                    sum(int(r["n"]) for r in own),
                    mean,
                    max(float(r["p95_m"]) for r in own),
                    100.0 * (mean / baseline - 1.0) if baseline > 0.0 else math.nan,
                    100.0 * _pooled(own, "inside_90"),
                )
            )
    title = f"Position error {horizon_s:g} s ahead, against the vehicle's own track"
    columns = ("vehicle", "model", "starts", "mean [m]", "worst p95 [m]", "vs cv [%]", "in 90 % ellipse [%]")
    return Section("prediction", title, columns, tuple(rows))


def _pooled(records: list[dict[str, Any]], name: str) -> float:
    """Mean of a per-vehicle mean, weighted by the number of starts; NaN without any."""
    n = sum(int(r["n"]) for r in records)
    return sum(float(r[name]) * int(r["n"]) for r in records if r["n"]) / n if n else math.nan
