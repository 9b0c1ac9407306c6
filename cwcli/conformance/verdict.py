"""What a judge gets and gives: a trial with its warnings, and a verdict with its margin."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field
from typing import Protocol

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

MARGIN_ROUNDING_TOLERANCE = 1e-9
"""A margin that is below zero by less than this is a pass, against rounding."""


class JudgedMotion(Protocol):
    """The true motion of a trial, as the judges need it; `Encounter` and `lane_trials.LaneDrift` are such."""

    @property
    def time_s(self) -> FloatArray: ...
    @property
    def event_s(self) -> float: ...
    @property
    def other_id(self) -> str: ...
    @property
    def contact_s(self) -> float: ...
    def values_at(self, time_s: float) -> dict[str, float]: ...
    def warning_text(self, values: Mapping[str, float]) -> str: ...


@dataclass(frozen=True)
class RaisedWarning:
    """A warning: when it could be known, and about which vehicle; "" where the system does not say."""

    raised_s: float
    other_id: str = ""


@dataclass(frozen=True)
class DrivenTrial:
    """A trial that was driven, simulated or recorded.

    Attributes:
        warnings: Every warning of the system during the trial, in order of time.
        demands: The numbers of the clause that the judge asks for, SI units.
        policy: Braking policy, a key of `policies.PEDALS_BY_POLICY`.
    """

    encounter: JudgedMotion
    warnings: tuple[RaisedWarning, ...]
    demands: Mapping[str, float]
    policy: str

    @property
    def warned_s(self) -> float:
        """When the first warning about the principal other was raised since the event began; NaN if none was."""
        for warning in self.warnings:
            is_about_other = warning.other_id in ("", self.encounter.other_id)
            if is_about_other and warning.raised_s >= self.encounter.event_s:
                return warning.raised_s
        return math.nan

    @property
    def n_warnings_before_event(self) -> int:
        """Number of warnings before the event began, which are about nothing."""
        return sum(warning.raised_s < self.encounter.event_s for warning in self.warnings)

    def demanded_number_si(self, name: str) -> float:
        """A number that the judge needs.

        Raises:
            UsageError: The clause's file does not give it.
        """
        if name not in self.demands:
            raise UsageError(f"a trial needs the number demands.{name}", hint="add it to the clause's file")
        return self.demands[name]


@dataclass(frozen=True)
class Verdict:
    """The verdict on one repetition.

    Attributes:
        margin: By how much it passes; negative: by how much it fails. NaN where there is no number.
        unit: Unit of the margin.
        text: What happened, in a few words.
        values: Numbers for the details, by name with unit: `ttc_s`.
        has_failed: It fails whatever the margin is.
    """

    margin: float
    unit: str
    text: str
    values: Mapping[str, float] = field(default_factory=dict)
    has_failed: bool = False

    @property
    def is_pass(self) -> bool:
        """Whether the repetition passes."""
        return not self.has_failed and not self.margin < -MARGIN_ROUNDING_TOLERANCE


@dataclass(frozen=True)
class WarningWindow:
    """When the first warning must come: not before `earliest_s`, not after `latest_s`, seconds of the trial."""

    earliest_s: float
    latest_s: float


def judge_by_window(driven: DrivenTrial, window: WarningWindow) -> Verdict:
    """Judge the first warning by a window of time; the margin is the time to the nearer end of the window, s."""
    if not math.isfinite(window.latest_s) or window.latest_s < window.earliest_s:
        raise UsageError(
            "a trial leaves no time in which a warning would pass",
            found=(
                f"it must come before {window.latest_s:.3f} s of the trial, but not before {window.earliest_s:.3f} s"
                if math.isfinite(window.latest_s)
                else "even at the trial's start, a warning would be too late",
            ),
            hint="check the speeds, the gap and the deceleration of the trial, and what is asked",
        )
    warned_s, encounter = driven.warned_s, driven.encounter
    values = {"earliest_s": window.earliest_s, "latest_s": window.latest_s, "warned_s": warned_s}
    if math.isnan(warned_s):
        end_s = encounter.contact_s if math.isfinite(encounter.contact_s) else float(encounter.time_s[-1])
        before = f" ({driven.n_warnings_before_event} before the event began)" if driven.n_warnings_before_event else ""
        return Verdict(-max(end_s - window.latest_s, 0.0), "s", f"no warning{before}", values, has_failed=True)
    values |= encounter.values_at(warned_s)
    late, early = window.latest_s - warned_s, warned_s - window.earliest_s
    margin = min(late, early) if math.isfinite(window.earliest_s) else late
    side = "in time" if margin >= -MARGIN_ROUNDING_TOLERANCE else ("too late" if late < early else "too early")
    return Verdict(margin, "s", f"{encounter.warning_text(values)}, {side}", values)
