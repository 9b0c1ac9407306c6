"""Which stages a log has the signals for, asked before each stage, when those before it have added theirs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cwcli.errors import MissingSignalError
from cwcli.signals.roles import ROLE_TEXT, Role, bind
from cwcli.stages.call import Selection, StageCall
from cwcli.stages.needs import NEEDS

if TYPE_CHECKING:
    from cwcli.logs.log import Log

DEFAULT_STAGES = tuple(stage for stage in NEEDS if stage != "control")
"""Replaying warnings with a controller is no part of looking at a drive; it runs when it is asked for."""
NO_REMOTE = "no channel holds remote vehicles (BSM or CAM messages)"
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
        required: Stage -> the roles that it needs with its configuration, where those differ from `NEEDS`.
    """

    ego_station: str | None = None
    required: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __call__(self, stage: str, log: Log, selection: Selection) -> Missing | None:
        """Why `stage` can't run on the log as it is now; None if it can.

        Raises:
            MissingSignalError: Two channels could be the ego's position: a choice that the user must make.
            UsageError: An override of a topic does not fit the log.
        """
        for name in self.required.get(stage, NEEDS[stage].required):
            role = Role(name)
            error = self._unbound(role, log, selection)
            if error is None:
                continue
            notes = bind(
                log.channels,
                selection.topics,
                required=(),
                optional=(role,),
                ego_station=self.ego_station,
                where=log.name,
            ).notes
            if notes and role is Role.EGO_POSITION:
                raise error
            return Missing(notes[0] if notes else self._reason(role, log, selection), error)
        return None

    def _unbound(self, role: Role, log: Log, selection: Selection) -> MissingSignalError | None:
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

    def _reason(self, role: Role, log: Log, selection: Selection) -> str:
        if role in (Role.REMOTE, Role.REMOTE_STATE, Role.REMOTE_PATH):
            return NO_REMOTE if self._unbound(Role.REMOTE, log, selection) else NO_REMOTE_MESSAGE
        return f"no channel holds {ROLE_TEXT[role]}"


def signals_for(calls: Mapping[str, StageCall], ego_station: str | None) -> SignalsFor:
    """The question with these stages' configurations in mind."""
    required: dict[str, tuple[str, ...]] = {}
    if "warn" in calls:
        config = calls["warn"].config
        if config.rules:  # each of them may need other roles; the stage leaves those out that it lacks
            required["warn"] = ()
        elif config.source == "targets":
            required["warn"] = ("ego_state", "ego_path", "targets")
    if "predict" in calls and calls["predict"].config.origin == "observer":
        required["predict"] = ("observer",)
    return SignalsFor(ego_station, required)
