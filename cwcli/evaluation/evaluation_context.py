"""Context of the evaluation of a log, which the evaluation of every stage receives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from cwcli.channels.vehicle_state import VehicleStates
from cwcli.evaluation.system_topics import OtherSystemTopics
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.metrics.headline import HeadlineCollector
from cwcli.metrics.table import Table
from cwcli.signals.columns import FloatArray, Int64Array

TRUTH_AUTO, TRUTH_NONE = "auto", "none"
"""Values of the option `--truth` that name no topic: the only truth channel of the log, and no truth."""


@dataclass(frozen=True)
class EgoTruth:
    """The truth of the ego in the map frame.

    Attributes:
        stamp_ns, xy: Stamps (n,) and positions (n, 2), m.
        speed_mps, heading_rad, yaw_rate_radps: Shape (n,), or None where the channel does not have them.
    """

    topic: str
    stamp_ns: Int64Array
    xy: FloatArray
    speed_mps: FloatArray | None = None
    heading_rad: FloatArray | None = None
    yaw_rate_radps: FloatArray | None = None


@dataclass(frozen=True)
class EgoStatesAndTruth:
    """States and truth of the ego for later metrics.

    Attributes:
        states: States in stamp order, or None where the log has none.
        truth: Truth, or None.
        notes: Notes on channels that were not used.
    """

    states: VehicleStates | None = None
    truth: EgoTruth | None = None
    notes: tuple[str, ...] = ()


@dataclass
class EvaluationContext:
    """A log under evaluation, with its options and metrics.

    Attributes:
        truth: `auto`, `none`, or the topic of the ego's truth.
        tables: Tables by name of the stages that have just made the channels.
        ego: States and truth of the ego, from the evaluation of `estimate`, which comes first.
        system: Another system in the log that is evaluated too.
    """

    log: Log
    truth: str = TRUTH_AUTO
    tables: Mapping[str, Table] = field(default_factory=dict)
    headline: HeadlineCollector = field(default_factory=HeadlineCollector)
    ego: EgoStatesAndTruth = EgoStatesAndTruth()
    system: OtherSystemTopics = field(default_factory=OtherSystemTopics)
    notes: list[str] = field(default_factory=list)

    @property
    def uses_truth(self) -> bool:
        """Whether truth channels are used."""
        return self.truth != TRUTH_NONE
