"""Stage `predict`: states in, predicted paths and their errors out."""

from __future__ import annotations

from typing import Annotated

from cwcli.channels.path_scene import make_path_scene_channel
from cwcli.channels.predicted_path import LazyPaths, make_lazy_path_channel
from cwcli.channels.published import EGO_PATH, EGO_STATE, REMOTE_PATH, REMOTE_STATE
from cwcli.channels.vehicle_state import VehicleStates
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.option import Option
from cwcli.pipeline.paths import PathRequest, plan_paths_from_states
from cwcli.pipeline.result import InputMessageCount, StageResult, StageSummary
from cwcli.pipeline.run_record import build_run_record
from cwcli.pipeline.states import StatesSelection, bind_state_channels, read_selected_states
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.prediction.rollout import Discretisation, check_rollout_options
from cwcli.signals.columns import OutputChannel
from cwcli.stages.inputs.sources import read_bound_columns

EXAMPLES = (
    "cwcli predict estimated.mcap -o predicted.mcap --horizon 3",
    "cwcli estimate drive.mcap -o - | cwcli predict - -o predicted.mcap",
)
"""Command lines that the help of `cwcli predict` shows."""


@dataclass(frozen=True)
class PredictConfig(StatesSelection):
    """Settings of the stage.

    Attributes:
        model: A key of `cwcli.prediction.models.MODELS`.
        horizon_s, step_s: Of the published paths; remote paths reach further, see `plan_paths_from_states`.
        discretisation: "exact", or "paper" for song2016's recursion.
        path_rate_hz: Paths of each vehicle that a file gets, at most.
    """

    model: Annotated[str, Option("--model", "{choices}", metavar="NAME", choices="cwcli.prediction.models:MODELS")] = (
        DEFAULT_MODEL
    )
    horizon_s: Annotated[float, Option("--horizon", "How far ahead to predict.", metavar="SECONDS")] = 2.5
    step_s: Annotated[float, Option("--step", "Time between the points of a path.", metavar="SECONDS")] = 0.05
    discretisation: Annotated[
        Discretisation,
        Option(
            "--discretisation",
            "exact: integrate the model exactly; paper: use the recursion of song2016 (eq. 2, 9, 10).",
        ),
    ] = "exact"
    path_rate_hz: Annotated[
        float,
        Option(
            "--path-rate",
            "Largest rate of each vehicle's paths in the written log; warnings use the paths of all states.",
            metavar="HZ",
            above=0.0,
        ),
    ] = 5.0

    def __post_init__(self) -> None:
        """Check what can be checked without a log.

        Raises:
            UsageError: An unknown model, or a horizon or step that is not positive.
        """
        check_rollout_options(self.model, self.discretisation, self.horizon_s, self.step_s)


def predict(log: Log, config: PredictConfig) -> StageResult:
    """Predict the path of every vehicle from each of its states.

    Needs the channels of `cwcli estimate`. Predicts a path with its covariance
    from each state, writes some of each second to the log, and compares every motion model with the later motion.

    Raises:
        MissingSignalError: The log has no ego state.
    """
    bound = bind_state_channels(
        log.channels,
        config,
        required=(EGO_STATE.role,),
        optional=(REMOTE_STATE.role,),
        where=log.name,
        command="predict",
    )
    columns = read_bound_columns(log, bound)
    channels: list[OutputChannel] = []
    predicted: list[LazyPaths] = []
    states_by_channel: dict[str, VehicleStates] = {}
    inputs: list[InputMessageCount] = []
    for role, path_channel in ((EGO_STATE.role, EGO_PATH), (REMOTE_STATE.role, REMOTE_PATH)):
        if role not in columns:
            continue
        states_by_channel[role], count = read_selected_states(log, columns[role], role, config)
        inputs.append(count)
        predicted.append(plan_paths_from_states(states_by_channel[role], role, PathRequest.from_stage_config(config)))
        channels.append(make_lazy_path_channel(path_channel, predicted[-1], rate_hz=config.path_rate_hz))
    channels.append(make_path_scene_channel(predicted))
    summary = StageSummary(title="predict", inputs=tuple(inputs), notes=bound.notes)
    record = build_run_record("predict", log, config, summary)
    return StageResult("predict", tuple(channels), {}, summary, record, evaluation_inputs=states_by_channel)
