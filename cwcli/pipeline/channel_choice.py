"""Which of the channels that a run makes go into the annotated log; later stages of the run see them all."""

from __future__ import annotations

import json
from collections import ChainMap
from collections.abc import Collection, Iterable, Mapping
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from cwcli.channels.published import schema_name_by_published_topic
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.stage import Stage

if TYPE_CHECKING:
    from cwcli.pipeline.result import StageResult

WRITTEN_TOPICS_KEY = "channels_written"
"""The entry of a run's record that lists the topics that were chosen."""


@dataclass(frozen=True)
class ChannelChoice:
    """The channels that are written.

    Attributes:
        patterns: Topics, `*` and `?` as in file names; empty for all.
    """

    patterns: tuple[str, ...] = ()

    @classmethod
    def parse(cls, option_values: Iterable[str]) -> ChannelChoice:
        """Parse the values of `--channels`; each may name several topics, with commas between them."""
        return cls(tuple(name.strip() for names in option_values for name in names.split(",")))

    def __bool__(self) -> bool:
        return bool(self.patterns)

    def __contains__(self, topic: object) -> bool:
        return not self.patterns or (isinstance(topic, str) and any(fnmatchcase(topic, each) for each in self.patterns))

    def check_patterns_before_run(self, stages: Iterable[Stage]) -> None:
        """Check the patterns before any stage runs; with a plug-in's stage, whose channels are unknown, do nothing."""
        if all(stage.package == Stage.package for stage in stages):
            self.check_patterns_match_topics()

    def check_patterns_match_topics(self, written_topics: Collection[str] = ()) -> None:
        """Check that each pattern matches a channel.

        Args:
            written_topics: Further topics, in addition to those that cwcli publishes.

        Raises:
            UsageError: A pattern matches none.
        """
        known = (*schema_name_by_published_topic(), *written_topics) if self.patterns else ()
        for each in self.patterns:
            if not any(fnmatchcase(topic, each) for topic in known):
                what = f"--channels {each}: cwcli writes no such channel"
                raise UsageError(what, found=tuple(sorted(known)), hint="name some of these; * stands for any part")

    def patterns_that_match_no_topic(self, written_topics: Collection[str]) -> tuple[str, ...]:
        """Return the patterns that match none of the topics of the run."""
        return tuple(each for each in self.patterns if not any(fnmatchcase(topic, each) for topic in written_topics))

    def record_with_written_topics(self, result: StageResult) -> Mapping[str, str]:
        """Return the record of a stage; if channels were chosen, it lists which of the stage's topics are written."""
        if not self.patterns:
            return result.metadata
        written_topics = [channel.topic for channel in result.channels if channel.topic in self]
        return ChainMap({WRITTEN_TOPICS_KEY: json.dumps(written_topics)}, result.metadata)  # type: ignore[arg-type]
