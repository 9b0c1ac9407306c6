"""Inputs of the warning rules: vehicles with their predicted paths, and options."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Literal, Protocol

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.option import Option
from cwcli.signals.clocks import earliest_known_times_ns
from cwcli.signals.columns import FloatArray, Int64Array, median_of_finite
from cwcli.warning.conflict_definition import (
    DEFAULT_CONFLICT,
    ConflictDefinition,
    format_default_definitions,
    parse_conflict_definition,
)

LeftAndRight = tuple[FloatArray, FloatArray]
"""One array of the left boundary and one of the right."""
EventIdByPairAndEvent = Mapping[tuple[int, int], int]
"""Number of the pair, and of the event in it -> id of the event."""

DEFAULT_VEHICLE_LENGTH_M = 4.5
"""Length of a vehicle that reports none. Chosen: a passenger car's."""
DEFAULT_VEHICLE_WIDTH_M = 1.8
"""Width of a vehicle that reports none. Chosen: a passenger car's."""

RemoteStateUse = Literal["received", "stamp"]
"""Which remote states count: those received by then, or all whose stamp has passed."""


class PathArrays(Protocol):
    """Predicted paths as plain arrays; `cwcli.prediction` computes them.

    `time_s` (k,) from 0 with a common step; the others (n, k), `position_covariance_m2` (n, k, 3): xx, xy, yy.
    """

    @property
    def time_s(self) -> FloatArray: ...
    @property
    def x_m(self) -> FloatArray: ...
    @property
    def y_m(self) -> FloatArray: ...
    @property
    def heading_rad(self) -> FloatArray: ...
    @property
    def speed_mps(self) -> FloatArray: ...
    @property
    def position_covariance_m2(self) -> FloatArray: ...


class PathSource(Protocol):
    """Predicted paths that may be computed on demand; plain arrays are a source of themselves."""

    @property
    def time_s(self) -> FloatArray: ...
    def paths_of_rows(self, rows: npt.NDArray[np.intp]) -> PathArrays: ...


@dataclass(frozen=True)
class VehicleTrack:
    """One vehicle: its states and the path predicted from each, in the map frame.

    Attributes:
        id: Vehicle id.
        stamp_ns: Shape (n,), strictly increasing: time of each state.
        log_time_ns: Shape (n,): when it was known to the host (reception for a remote vehicle).
        state: Shape (n, 8), as in `cwcli.v1.VehicleState`; position is the centre of the outline.
        paths: n predicted paths.
        length_m, width_m: Outline; NaN or None: 4.5 m and 1.8 m.
        flags: Shape (n,): `StateFlag`s; None: no state has one. A state that has one raises no warning.
        says_hard_braking: Shape (n,): it has sent that it brakes hard (a BSM's flag, a DENM); None: it sends nothing.
        onset_paths: n more paths: a manoeuvre that has begun goes on to the car's limits (`prediction`'s hypothesis
            "onset"), for the default rule; None: the rule works without them.
    """

    id: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    state: FloatArray
    paths: PathSource
    length_m: float | None = None
    width_m: float | None = None
    onset_paths: PathSource | None = None
    flags: npt.NDArray[np.uint8] | None = None
    says_hard_braking: npt.NDArray[np.bool_] | None = None

    @cached_property
    def known_ns(self) -> Int64Array:
        """When the results at each state could have been known, on the clock of the stamps, (n,).

        That holds for results about others too: the host uses only their states that it had received (`align`).
        """
        return earliest_known_times_ns(self.stamp_ns, self.log_time_ns)

    @property
    def length_and_width_m(self) -> tuple[float, float]:
        """Length and width in metres; the defaults where they are not reported."""
        return _positive_or_default(self.length_m, DEFAULT_VEHICLE_LENGTH_M), _positive_or_default(
            self.width_m, DEFAULT_VEHICLE_WIDTH_M
        )


def median_length_and_width_m(lengths_m: FloatArray, widths_m: FloatArray) -> tuple[float, float]:
    """Median length and width (m) of what a vehicle reported, (n,) each; the defaults where it reported none."""
    length_m, width_m = median_of_finite(lengths_m), median_of_finite(widths_m)
    return _positive_or_default(length_m, DEFAULT_VEHICLE_LENGTH_M), _positive_or_default(
        width_m, DEFAULT_VEHICLE_WIDTH_M
    )


def _positive_or_default(value: float | None, default: float) -> float:
    """The value if it is positive, else the default."""
    return float(value) if value is not None and value > 0.0 else default


def _conflict_help_text() -> str:
    return (
        f"What counts as a conflict when warnings are scored: a measure beyond its threshold "
        f"({format_default_definitions()}), or "
        "beyond one of yours: 'ttc < 1.5'; several with 'or' between, the one that dates the conflict first. distance "
        "alone is that of --distance."
    )


@dataclass(frozen=True)
class WarningConfig:
    """Options of the warnings and of their scores.

    Attributes:
        rule: A key of `RULES`.
        horizon_s: Warn when the event is at most this far ahead (song2016: 2.5 s).
        max_horizon_s: The default rule looks up to this far ahead where braking takes that long
            (`warning.braking_horizon`); `horizon_s` or less: it never looks farther than that.
        distance_m: Centres nearer than this are a collision (song2016: 2.5 m).
        probability: The default rule's threshold on the probability of contact within the horizon.
        min_deceleration_mps2: The default rule does not warn of what gentler braking by the host makes improbable; 0:
            it always does.
        persistence_s: How long the rule's condition must have held before the warning; None: the rule's own.
        from_behind: Warn of a follower in the host's lane, too (rule "cwcli"); the host cannot avoid it.
        beside_lane: Warn of a vehicle that drives parallel in a lane of its own, too (rule "cwcli").
        while_standing: Warn a host that stands, too (rule "cwcli"); it cannot avoid anything by braking.
        hold_off_s: A condition that has been false this long is over; until then it is the same conflict.
        use: "received": of the remote states only those that had been received by then, as on line. "stamp": all
            whose stamp has passed (no link delay).
        max_age_s: Remote states older than this are not used.
        max_gap_s: Tracks are not interpolated across gaps longer than this when warnings are scored.
        conflict: What counts as a conflict when warnings are scored: a key of `measures.MEASURES`, at its own
            threshold ("distance": at `distance_m`) or at another one: "ttc < 1.5"; or several of these with " or "
            between (`parse_conflict_definition`).
        max_lead_s: A warning earlier than this before a conflict is not about that conflict.
    """

    rule: Annotated[str, Option("--rule", "{choices}", metavar="NAME", choices="cwcli.warning.rules:RULES")] = "cwcli"
    horizon_s: Annotated[float, Option("--horizon", "Warn of events at most this far ahead.", metavar="SECONDS")] = 2.5
    max_horizon_s: Annotated[
        float,
        Option(
            "--max-horizon",
            "Longest look-ahead of the rule cwcli, used where braking takes that long; 0: never beyond --horizon.",
            metavar="SECONDS",
        ),
    ] = 3.7
    distance_m: Annotated[
        float, Option("--distance", "Centres nearer than this are a collision.", metavar="METRES")
    ] = 2.5
    probability: Annotated[
        float, Option("--probability", "Least probability of contact at which the rule cwcli warns.", metavar="P")
    ] = 0.65
    min_deceleration_mps2: Annotated[
        float,
        Option(
            "--min-deceleration",
            "The rule cwcli does not warn while braking this gently would avoid contact; 0: it warns all the same.",
            metavar="M/S2",
        ),
    ] = 2.0
    persistence_s: Annotated[
        float | None,
        Option(
            "--persistence",
            "How long the condition must hold before the warning.",
            metavar="SECONDS",
            default="the rule's own",
        ),
    ] = None
    from_behind: Annotated[
        bool,
        Option("--from-behind", "The rule cwcli also warns of vehicles that approach from behind in the host's line."),
    ] = False
    beside_lane: Annotated[
        bool,
        Option(
            "--beside-lane", "The rule cwcli also warns of vehicles that drive parallel to the host next to its lane."
        ),
    ] = False
    while_standing: Annotated[
        bool,
        Option("--while-standing", "The rule cwcli also warns while the host stands, when braking avoids nothing."),
    ] = False
    hold_off_s: Annotated[
        float,
        Option("--hold-off", "A warning ends when its condition has been false for this long.", metavar="SECONDS"),
    ] = 1.0
    use: Annotated[
        RemoteStateUse,
        Option(
            "--use",
            "received: use remote states from their reception on; stamp: from their "
            "stamp on, as if there were no delay.",
        ),
    ] = "received"
    max_age_s: Annotated[float, Option("--max-age", "Do not use remote states older than this.", metavar="SECONDS")] = (
        1.0
    )
    max_gap_s: float = 0.5
    conflict: Annotated[
        str, Option("--conflict", _conflict_help_text, metavar="MEASURE", choices="cwcli.measures:MEASURES")
    ] = DEFAULT_CONFLICT
    max_lead_s: Annotated[
        float,
        Option(
            "--max-lead",
            "A warning that comes earlier than this before a conflict does not count as its warning.",
            metavar="SECONDS",
        ),
    ] = 5.0

    @property
    def parsed_conflict_definition(self) -> ConflictDefinition:
        """The parsed definition of a conflict.

        Raises:
            UsageError: `conflict` is not a definition.
        """
        return parse_conflict_definition(self.conflict, distance_m=self.distance_m)
