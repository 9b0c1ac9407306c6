"""A stage with its configuration, as a value that can be sent to another process."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cwcli.pipeline.stage import Stage

if TYPE_CHECKING:
    from cwcli.logs.read.reader import Log
    from cwcli.pipeline.result import StageResult


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What a run uses of one log; the configuration of a stage is one with settings.

    Attributes:
        topics: Role -> topic, the user's choices.
        start_ns, end_ns: Only messages logged in this span are used.
    """

    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None

    def includes_log_time(self, log_time_ns: int) -> bool:
        """Whether a message of this log time is used."""
        after_start = self.start_ns is None or log_time_ns >= self.start_ns
        return after_start and (self.end_ns is None or log_time_ns < self.end_ns)


Call = Callable[["Log", Selection], "StageResult"]


@dataclass(frozen=True)
class StageCall:
    """One stage and its configuration; calling it runs the stage.

    Attributes:
        stage: Of `cwcli.stages.STAGES`.
        config: Its frozen configuration, without the part that differs from log to log.
    """

    stage: Stage
    config: Any

    def __call__(self, log: Log, selection: Selection) -> StageResult:
        """Run the stage on a log.

        Raises:
            CwcliError: As the stage does.
        """
        return run_stage(self.stage, log, replace_selection(self.config, selection))


def run_stage(stage: Stage, log: Log, config: Any) -> StageResult:
    """Run a stage, and let its evaluation say how good it is, where it has one.

    The evaluation is a module of `cwcli.evaluation`. Its function `judge_result`, if there is one, takes the log, the
    configuration and the result, and gives the result with further sections, tables and notes (`StageResult.judged`);
    its function `add_metrics` adds headline metrics (`cwcli.evaluation.evaluate_log`).
    """
    result: StageResult = stage.stage_function(log, config)
    judge: Callable[[Log, Any, StageResult], StageResult] | None = getattr(
        stage.evaluation_module, "judge_result", None
    )
    return result if judge is None else judge(log, config, result)


def replace_selection(config: Any, selection: Selection) -> Any:
    """A stage's configuration with the selection in it: in its `sources`, where it has them, else in itself."""
    chosen = {"topics": selection.topics, "start_ns": selection.start_ns, "end_ns": selection.end_ns}
    if hasattr(config, "sources"):
        return dataclasses.replace(config, sources=dataclasses.replace(config.sources, **chosen))
    return dataclasses.replace(config, **chosen)
