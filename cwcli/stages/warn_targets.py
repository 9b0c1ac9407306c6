"""Stage `warn-targets`: the targets of `cwcli track` in, warnings of collisions with them out."""

from __future__ import annotations

from cwcli.channels.published import TARGETS
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.result import StageResult
from cwcli.stages.warn import WarnConfig, warn_ego_of_others

EXAMPLES = (
    "cwcli warn-targets tracked.mcap -o warned.mcap",
    "cwcli warn-targets tracked.mcap --rule path-ttc --json",
)
"""Command lines that the help of `cwcli warn-targets` shows."""


@dataclass(frozen=True)
class WarnTargetsConfig(WarnConfig):
    """Settings of the stage: those of `warn`."""


def warn_targets(log: Log, config: WarnTargetsConfig) -> StageResult:
    """Warn the ego vehicle of collisions with tracked targets.

    Needs the channels of `cwcli track` and of `cwcli predict`. Targets are predicted like the ego, with the model, the
    step and the horizon of its paths.

    Raises:
        MissingSignalError: The log lacks the ego's states or paths, or targets.
        DataError: The paths' motion model is not known.
    """
    return warn_ego_of_others(log, config, "warn-targets", (TARGETS.role,))
