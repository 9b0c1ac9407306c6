"""Stage `predict`: states in, predicted paths and their errors out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from cwcli.channels.binding import bind
from cwcli.channels.path_scene import write_path_scene
from cwcli.channels.predicted_path import PredictedPaths, write_paths
from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_PATH, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates, read_states, require_ego
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.result import InputCount, StageResult, Summary
from cwcli.pipeline.run_record import run_record
from cwcli.prediction.calibrate import predict_vehicles
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.prediction.rollout import Discretisation, check_request
from cwcli.signals.columns import OutputChannel

EXAMPLES = (
    "cwcli predict estimated.mcap -o predicted.mcap --horizon 3",
    "cwcli estimate drive.mcap -o - | cwcli predict - -o predicted.mcap",
)
MAX_MESSAGE_AGE_S = 1.0
"""How much longer than the horizon a remote path is: its state is older than the moment at which it is used."""


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
    made: list[VehicleStates] = []
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
        made.append(states)
    channels.append(write_path_scene(predicted))
    summary = Summary(title="predict", inputs=tuple(inputs), notes=bound.notes)
    record = run_record("predict", log, config, summary)
    return StageResult("predict", tuple(channels), {}, summary, record, made=tuple(made))
