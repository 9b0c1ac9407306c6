"""Which stages a log has the signals for, asked before each stage, when those before it have added theirs."""

from __future__ import annotations

from cwcli.channels.binding import DESCRIPTION_BY_ROLE, bind_roles
from cwcli.channels.published import REMOTE_PATH, REMOTE_STATE
from cwcli.errors import MissingSignalError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.pipeline.call import Selection
from cwcli.pipeline.needs import StageByName, readiness_of_each_stage
from cwcli.pipeline.stage import Stage
from cwcli.pipeline.stations import add_stations_to_error
from cwcli.signals.role import Role

NO_REMOTE_CHANNEL_TEXT = "the log has no messages of other vehicles (BSM or CAM)"
"""The reason for leaving a stage out where no channel binds to the role of remote vehicles."""
NO_REMOTE_MESSAGE_TEXT = "no message of another vehicle could be used"
"""The reason for leaving a stage out where such a channel exists and gave no state."""


@dataclass(frozen=True)
class MissingSignals:
    """Why a stage can't run on a log.

    Attributes:
        error: The same as an error, for a log on which nothing can run.
    """

    reason: str
    error: MissingSignalError | None = None


@dataclass(frozen=True)
class SignalCheck:
    """Checks whether a log has the signals that a stage needs.

    Attributes:
        stages: Name -> stage, all of them.
        ego_station: V2X station of the ego, or None.
    """

    stages: StageByName
    ego_station: str | None = None

    def __call__(self, stage: str, log: Log, selection: Selection) -> MissingSignals | None:
        """Return why `stage` can't run on the log as it is now; None if it can.

        Raises:
            MissingSignalError: Two channels could be the ego's position: a choice that the user must make.
            UsageError: An override of a topic does not fit the log.
        """
        for group in self.stages[stage].required_role_groups:
            errors = [self._binding_error_or_none(name, log, selection) for name in group]
            role, error = group[0], errors[0]
            if error is None or None in errors:
                continue
            notes = bind_roles(
                log.channels,
                selection.topics,
                required=(),
                optional=(role,),
                ego_station=self.ego_station,
                where=log.name,
            ).notes
            if notes and role == Role.EGO_POSITION:
                raise error
            return MissingSignals(
                notes[0] if notes else self._format_reason_of_missing_role(stage, role, log, selection), error
            )
        return None

    def _binding_error_or_none(self, role: str, log: Log, selection: Selection) -> MissingSignalError | None:
        """Return the error of binding one role, with the V2X stations for the ego's position; else None."""
        try:
            bind_roles(
                log.channels,
                selection.topics,
                required=(role,),
                ego_station=self.ego_station,
                where=log.name,
                command="run",
            )
        except MissingSignalError as error:
            if role == Role.EGO_POSITION:
                return add_stations_to_error(error, log, ego_station=self.ego_station)
            return error
        return None

    def _format_reason_of_missing_role(self, stage: str, role: str, log: Log, selection: Selection) -> str:
        """Return why the stage is left out for lack of a role, in one line."""
        if role in (Role.REMOTE, REMOTE_STATE.role, REMOTE_PATH.role):
            return (
                NO_REMOTE_CHANNEL_TEXT
                if self._binding_error_or_none(Role.REMOTE, log, selection)
                else NO_REMOTE_MESSAGE_TEXT
            )
        return (
            f"no channel holds {DESCRIPTION_BY_ROLE[role]}{self._suggest_other_stages_or_empty(stage, log, selection)}"
        )

    def _suggest_other_stages_or_empty(self, stage: str, log: Log, selection: Selection) -> str:
        """Return words on stages that do the same from other signals, if the file holds those; else ""."""
        added = {channel.topic for channel in log.added_channels}
        recorded_channels = [channel for channel in log.channels if channel.topic not in added]
        bound = bind_roles(
            recorded_channels,
            {},
            required=(),
            optional=tuple(DESCRIPTION_BY_ROLE),
            ego_station=self.ego_station,
            where=log.name,
        ).by_role
        for entry in readiness_of_each_stage(bound, self.stages):
            if entry.stage.instead_of == stage and not entry.missing:
                return f" (another way: --stage {','.join((*entry.after, entry.stage.name))})"
        return ""


@dataclass(frozen=True)
class SkipStagesAlreadyRun:
    """Skips the stages that a stage's command runs first if the log already holds their channels.

    Attributes:
        stages: Name -> stage, all of them.
        ego_station: V2X station of the ego, or None.
    """

    stage: Stage
    stages: StageByName
    ego_station: str | None = None

    def __call__(self, name: str, log: Log, selection: Selection) -> MissingSignals | None:
        """Return why a stage is skipped; None if it runs.

        Raises:
            MissingSignalError: The log has neither all of its channels nor the sensors to compute them from.
        """
        if name not in self.stage.first:
            return None
        already_run = {
            role: source
            for role, source in self.stages[name].input_role_by_added_role.items()
            if role in self.stage.required
        }
        found = bind_roles(log.channels, selection.topics, required=(), optional=tuple(already_run), where=log.name)
        is_there = any(role in found for role in already_run)
        bind_roles(
            log.channels,
            selection.topics,
            required=tuple(already_run if is_there else already_run.values()),
            ego_station=self.ego_station,
            where=log.name,
            command=self.stage.name,
        )
        return MissingSignals("the log holds the states") if is_there else None
