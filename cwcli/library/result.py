"""What stages have made of a log (`cwcli.Log.run`)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cwcli.channels.published import (
    EGO_STATE,
    PAIR_MEASURES,
    PUBLISHED_CHANNELS,
    REMOTE_STATE,
    TARGETS,
    WARNINGS,
    Channel,
)
from cwcli.library.tables import arrow_table_of_doubts, arrow_table_of_result, arrow_table_of_topic
from cwcli.pipeline.call import Selection

if TYPE_CHECKING:
    import pyarrow as pa

    from cwcli.logs.read import reader
    from cwcli.pipeline.channel_choice import ChannelChoice
    from cwcli.pipeline.execute import RunOutcome

WHOLE_LOG_SELECTION = Selection()
"""The selection of every message."""


class Result:
    """The outcome of stages on a log; its tables are made when they are asked for.

    Attributes:
        name: Name of the log.
        stages: Stages that ran, in order.
        left_out: Stage that did not run -> the reason.
        faults: What is wrong with the input file -> how often.
    """

    def __init__(
        self, require_open: Callable[[], None], annotated: reader.Log, outcome: RunOutcome, choice: ChannelChoice
    ) -> None:
        """Hold the results; `require_open` raises `UsageError` if the log is closed that they belong to."""
        self._require_open = require_open
        self.annotated, self.outcome, self.choice = annotated, outcome, choice
        self.name: str = outcome.name
        self.stages: tuple[str, ...] = tuple(result.stage for result in outcome.results)
        self.left_out: dict[str, str] = dict(outcome.left_out)
        self.faults: dict[str, int] = dict(outcome.faults)

    @property
    def ego(self) -> pa.Table:
        """States of the ego, `/cwcli/ego/state`.

        Raises:
            MissingSignalError: `estimate` has not run.
        """
        return self._published_table(EGO_STATE)

    @property
    def others(self) -> pa.Table:
        """States of the vehicles that send V2X messages, `/cwcli/remote/state`; no rows where there are none.

        Raises:
            MissingSignalError: `estimate` has not run.
        """
        return self._published_table(REMOTE_STATE, or_empty=True)

    @property
    def targets(self) -> pa.Table:
        """Targets tracked from detections, `/cwcli/targets`.

        Raises:
            MissingSignalError: `track` has not run.
        """
        return self._published_table(TARGETS)

    @property
    def warnings(self) -> pa.Table:
        """Warnings from when they are raised until they are cleared, `/cwcli/warnings`; no rows where there are none.

        Raises:
            MissingSignalError: `warn` has not run.
        """
        return self._published_table(WARNINGS, or_empty=True)

    @property
    def measures(self) -> pa.Table:
        """How critical each pair of vehicles was, `/cwcli/measures`; no rows where there are none.

        Raises:
            MissingSignalError: `measure` has not run.
        """
        return self._published_table(PAIR_MEASURES, or_empty=True)

    @property
    def doubts(self) -> pa.Table:
        """Reasons not to believe the results as they are, the worst first; no rows where there is no doubt.

        Columns: `name` of the rule, `sentence`, `advice`, `value` (of the number that exceeds the threshold),
        `threshold`, and `unit` of both ("" for counts and ratios).
        """
        from cwcli.evaluation.doubts import find_doubts

        return arrow_table_of_doubts(find_doubts(self.annotated))

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics of the log with those that the stages have added."""
        return tuple(dict.fromkeys(channel.topic for channel in self.annotated.channels))

    @property
    def scores(self) -> dict[str, pa.Table]:
        """The stages' tables of metrics by name, as `--metrics-dir` writes them."""
        from cwcli.metrics.table import to_arrow_table

        return {name: to_arrow_table(table) for name, table in self.outcome.tables_by_name().items()}

    @property
    def summary(self) -> dict[str, Any]:
        """Stage -> its summary: what `--json` prints of it."""
        return {result.stage: result.summary.to_json() for result in self.outcome.results}

    def table(self, topic: str) -> pa.Table:
        """Read any channel as an Arrow table, one row a message; times are int64, ns since the epoch.

        Raises:
            MissingSignalError: There is no such channel.
            InputError: It can't be decoded, or the log is damaged.
            UsageError: The log is closed, and the channel is in its file.
        """
        self._require_in_memory_or_open(topic)
        return arrow_table_of_topic(self.annotated, topic, WHOLE_LOG_SELECTION)

    def save(
        self,
        target: str | Path,
        *,
        tables: str | Path | None = None,
        replace: bool = False,
        split: bool = False,
        force: bool = False,
    ) -> list[Path]:
        """Write the annotated log: the log's messages byte for byte, and the new channels. All files appear or none.

        Args:
            target: The file; with `split` the folder of the parts.
            tables: Folder for the tables of metrics, as Parquet.
            replace: Leave out channels of an earlier run that the new ones replace.
            split: Write the parts in which the log came.
            force: Overwrite files that exist.

        Returns:
            The files.

        Raises:
            OutputError: A file exists or can't be written, or the log holds such channels already.
            InputError: The log changed while it was read.
            UsageError: The log is closed.
        """
        from cwcli.library.writing import OutputFiles, write_outputs

        self._require_open()
        files = OutputFiles(
            annotated=f"./{target}" if str(target) == "-" else str(target),
            tables_folder=None if tables is None else str(tables),
            replace=replace,
            is_folder_of_parts=split,
            force=force,
        )
        file_names = write_outputs(self, files)
        return list(map(Path, file_names.names))

    def __repr__(self) -> str:
        return f"<cwcli.Result {self.name!r}: {', '.join(self.stages)}>"

    def _published_table(self, channel: Channel, *, or_empty: bool = False) -> pa.Table:
        """Read a channel that a stage publishes; without rows if the stage has run and published nothing on it."""
        self._require_in_memory_or_open(channel.topic)
        its_stage = {each.topic for each in PUBLISHED_CHANNELS if each.stage == channel.stage}
        was_tried = channel.stage in (*self.stages, *self.left_out) or not its_stage.isdisjoint(self.topics)
        return arrow_table_of_result(self.annotated, channel, WHOLE_LOG_SELECTION, may_be_empty=or_empty and was_tried)

    def _require_in_memory_or_open(self, topic: str) -> None:
        """Raise `UsageError` if a channel lies in the file of a log that is closed."""
        if topic not in {channel.topic for channel in self.annotated.added_channels}:
            self._require_open()
