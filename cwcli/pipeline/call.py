"""A stage with its options already in it, as a value that can be sent to another process."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cwcli.logs.log import Log
    from cwcli.pipeline.result import StageResult


@dataclass(frozen=True)
class Selection:
    """What a run uses of one log.

    Attributes:
        topics: Role -> topic, the user's choices.
        start_ns, end_ns: Only messages logged in this span are used.
    """

    topics: Mapping[str, str] = field(default_factory=dict)
    start_ns: int | None = None
    end_ns: int | None = None


Stage = Callable[["Log", Selection], "StageResult"]


@dataclass(frozen=True)
class StageCall:
    """One stage and its configuration; calling it runs the stage.

    Attributes:
        stage: Its name: the function of this name in the module `cwcli.stages.<name>`.
        config: Its frozen configuration, without the part that differs from log to log.
    """

    stage: str
    config: Any

    def __call__(self, log: Log, selection: Selection) -> StageResult:
        """Run the stage on a log.

        Raises:
            CwcliError: As the stage does.
        """
        function: Callable[[Log, Any], StageResult] = getattr(
            importlib.import_module(f"cwcli.stages.{self.stage}"), self.stage
        )
        return function(log, with_selection(self.config, selection))


def with_selection(config: Any, selection: Selection) -> Any:
    """A stage's configuration with the selection in it: in its `sources`, where it has them, else in itself."""
    chosen = {"topics": selection.topics, "start_ns": selection.start_ns, "end_ns": selection.end_ns}
    if hasattr(config, "sources"):
        return dataclasses.replace(config, sources=dataclasses.replace(config.sources, **chosen))
    return dataclasses.replace(config, **chosen)
