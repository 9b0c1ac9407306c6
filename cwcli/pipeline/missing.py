"""Which stages a log has the signals for, asked before each stage, when those before it have added theirs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cwcli.channels.binding import ROLE_TEXT, bind
from cwcli.channels.published import OBSERVER, REMOTE_PATH, REMOTE_STATE
from cwcli.errors import MissingSignalError
from cwcli.pipeline.call import Selection, StageCall
from cwcli.pipeline.needs import NEEDS, PREDICT_FROM_OBSERVER, STAGES, WARN_OF_TARGETS, Need
from cwcli.signals.codec import Role

if TYPE_CHECKING:
    from cwcli.logs.log import Log

DEFAULT_STAGES = tuple(stage for stage in STAGES if stage != "control")
"""Replaying warnings with a controller is no part of looking at a drive; it runs when it is asked for."""
NO_REMOTE = "no channel holds remote vehicles (BSM or CAM messages)"
FROM_CAMERA = {
    "predict": "--predict-from observer",
    "warn": "--predict-from observer --warn-rules lane-departure",
}
"""Stage -> the options of `cwcli run` with which it needs no position."""
NO_REMOTE_MESSAGE = "no message of another vehicle could be used"


@dataclass(frozen=True)
class Missing:
    """Why a stage can't run on a log.

    Attributes:
        reason: One line.
        error: The same as an error, for a log on which nothing can run.
    """

    reason: str
    error: MissingSignalError | None = None


@dataclass(frozen=True)
class SignalsFor:
    """Tells why a stage can't run on a log.

    Attributes:
        ego_station: V2X station of the ego, or None.
        needs: Stage -> what it needs with its configuration, where that differs from `NEEDS`.
    """

    ego_station: str | None = None
    needs: Mapping[str, Need] = field(default_factory=dict)

    def __call__(self, stage: str, log: Log, selection: Selection) -> Missing | None:
        """Why `stage` can't run on the log as it is now; None if it can.

        Raises:
            MissingSignalError: Two channels could be the ego's position: a choice that the user must make.
            UsageError: An override of a topic does not fit the log.
        """
        for group in self.needs.get(stage, NEEDS[stage]).groups:
            errors = [self._unbound(name, log, selection) for name in group]
            role, error = group[0], errors[0]
            if error is None or None in errors:
                continue
            notes = bind(
                log.channels,
                selection.topics,
                required=(),
                optional=(role,),
                ego_station=self.ego_station,
                where=log.name,
            ).notes
            if notes and role == Role.EGO_POSITION:
                raise error
            return Missing(notes[0] if notes else self._reason(stage, role, log, selection), error)
        return None

    def _unbound(self, role: str, log: Log, selection: Selection) -> MissingSignalError | None:
        try:
            bind(
                log.channels,
                selection.topics,
                required=(role,),
                ego_station=self.ego_station,
                where=log.name,
                command="run",
            )
        except MissingSignalError as error:
            return error
        return None

    def _reason(self, stage: str, role: str, log: Log, selection: Selection) -> str:
        if role in (Role.REMOTE, REMOTE_STATE.role, REMOTE_PATH.role):
            return NO_REMOTE if self._unbound(Role.REMOTE, log, selection) else NO_REMOTE_MESSAGE
        reason = f"no channel holds {ROLE_TEXT[role]}"
        has_observer = self._unbound(OBSERVER.role, log, selection) is None
        return f"{reason} (from the camera: {FROM_CAMERA[stage]})" if has_observer and stage in FROM_CAMERA else reason


def signals_for(calls: Mapping[str, StageCall], ego_station: str | None) -> SignalsFor:
    """The question with these stages' configurations in mind."""
    needs: dict[str, Need] = {}
    if "warn" in calls:
        config = calls["warn"].config
        if config.rules:  # each of them may need other roles; the stage leaves those out that it lacks
            needs["warn"] = Need(required=())
        elif config.source == "targets":
            needs["warn"] = NEEDS[WARN_OF_TARGETS]
    if "predict" in calls and calls["predict"].config.origin == "observer":
        needs["predict"] = NEEDS[PREDICT_FROM_OBSERVER]
    return SignalsFor(ego_station, needs)
