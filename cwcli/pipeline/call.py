"""A stage with its configuration, as a value that can be sent to another process."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any

from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.stage import Stage

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log
    from cwcli.pipeline.result import StageResult


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The part of one log that a run uses; a stage's configuration is a selection with the stage's settings.

    Attributes:
        topics: Role -> topic, as the user chose.
        start_ns, end_ns: Log times [ns]; messages logged from the start to before the end are used. None: no bound.
    """

    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None

    def includes_log_time(self, log_time_ns: int) -> bool:
        """Return whether a message with this log time [ns] is used."""
        after_start = self.start_ns is None or log_time_ns >= self.start_ns
        return after_start and (self.end_ns is None or log_time_ns < self.end_ns)


Call = Callable[["Log", Selection], "StageResult"]


@dataclass(frozen=True)
class StageCall:
    """One stage and its configuration; calling it runs the stage.

    Attributes:
        stage: An entry of `cwcli.stages.STAGES`.
        config: The stage's frozen configuration, without the part that differs from log to log.
    """

    stage: Stage
    config: Any

    def __call__(self, log: Log, selection: Selection) -> StageResult:
        """Run the stage on a log.

        Raises:
            CwcliError: As the stage does.
        """
        return run_stage(self.stage, log, config_with_selection(self.config, selection))


def run_stage(stage: Stage, log: Log, config: Any) -> StageResult:
    """Run a stage, and then its evaluation if it has one.

    The evaluation is a module of `cwcli.evaluation`. Its `add_scores_to_result`, if present, takes the log, the
    configuration and the result, and returns the result with further sections, tables and notes
    (`StageResult.with_evaluation`); its function `add_metrics` adds headline metrics (`cwcli.evaluation.evaluate_log`).
    """
    result: StageResult = stage.stage_function(log, config)
    judge: Callable[[Log, Any, StageResult], StageResult] | None = getattr(
        stage.evaluation_module, "add_scores_to_result", None
    )
    return result if judge is None else judge(log, config, result)


def config_with_selection(config: Any, selection: Selection) -> Any:
    """Return a stage's configuration with the selection, which goes into its `sources` if it has that field."""
    chosen = {"topics": selection.topics, "start_ns": selection.start_ns, "end_ns": selection.end_ns}
    if hasattr(config, "sources"):
        return dataclasses.replace(config, sources=dataclasses.replace(config.sources, **chosen))
    return dataclasses.replace(config, **chosen)
