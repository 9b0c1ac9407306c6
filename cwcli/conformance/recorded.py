"""A recorded trial: found in a log, checked against the clause's tolerances, and judged like a simulated one.

After the driver has reacted, the recorded motion no longer shows when the contact would have been. So the motion goes
on without a reaction from there: the host at its speed, the other at its deceleration until it stands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from cwcli.channels.published import WARNINGS
from cwcli.channels.warning import read_warnings, warning_events_with_known_start
from cwcli.conformance.clause import Clause, Trial, clause_names, load_clause, load_clauses
from cwcli.conformance.encounter import Encounter
from cwcli.conformance.online import run_missing_stages
from cwcli.conformance.results import ClauseResult, Repetition, TrialResult
from cwcli.conformance.run import ConformConfig, judge_driven_trial, settings_of_clause_run
from cwcli.conformance.validity import (
    SCENES_RECOGNISABLE_IN_LOGS,
    checked_start_and_end_s,
    find_tolerance_breaches,
    match_encounter_with_trial,
)
from cwcli.conformance.verdict import DrivenTrial, RaisedWarning
from cwcli.errors import DataError, MissingSignalError, UsageError
from cwcli.evaluation.actual_outcomes import ActualOutcomes, find_actual_outcomes
from cwcli.evaluation.system.flag import read_flag_from_topic
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures.pair import Pair
from cwcli.signals.columns import FloatArray
from cwcli.signals.field_condition import CONDITION_EXAMPLES_HINT, parse_condition
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED, X, Y

MAX_SPEED_DIFFERENCE_FROM_TRIAL_IN_TOLERANCES = 4.0
"""A recorded drive is a trial of the clause if its speeds are within this many tolerances of the trial's. Chosen by
hand: the trials of the clauses differ by more."""
MOTION_CONTINUED_WITHOUT_REACTION_S = 12.0
"""Time, s, for which the host's motion is continued from its reaction on, as if it had not reacted. Chosen by
hand: longer than every time to collision."""
UNREACTED_MOTION_STEP_S = 0.02
"""Time step, s, of the host's motion as if it had not reacted. Chosen by hand."""
DEFAULT_MIN_DECELERATION_OF_HOST_REACTION_MPS2 = 0.15 * 9.80665
"""Deceleration from which on the host reacts, m/s^2, where the clause gives none (49 CFR 571.127: 0.15 g)."""


@dataclass(frozen=True)
class LogTrial:
    """Where a recorded trial is.

    Attributes:
        system: Topic and condition of another system's warnings, or None: those of cwcli.
        lead: Id of the other vehicle, or None: the only one that could be it.
        start_s, end_s: The trial's window, seconds from the log's start; None: the whole log.
    """

    name: str
    system: str | None = None
    lead: str | None = None
    start_s: float | None = None
    end_s: float | None = None


def judge_log(clause_name: str, place: LogTrial, config: ConformConfig) -> ClauseResult:
    """Judge the trial of a clause that was recorded in a log.

    Raises:
        UsageError: The clause, the window or the lead does not exist.
        DataError: The log holds no trial of the clause.
        MissingSignalError: It lacks the states or the warnings, or several vehicles could be the lead.
        InputError: It can't be read.
    """
    clause = load_clause(clause_name)
    if not clause.tolerances:
        known = ", ".join(name for name in clause_names() if load_clause(name).tolerances)
        raise UsageError(f"{clause.name} has no tolerances of recorded trials", hint=f"clauses that have: {known}")
    if place.start_s is not None and place.end_s is not None and not place.start_s < place.end_s:
        raise UsageError(f"--start {place.start_s:g} is not before --end {place.end_s:g}")
    with Log.open(place.name) as log:
        with_states = run_missing_stages(
            log, config.rule, horizon_s=config.horizon_s, with_warnings=place.system is None
        )
        real = find_actual_outcomes(with_states)
        if real is None or not real.pairs:
            raise MissingSignalError(
                "it never holds the ego and another vehicle at the same time, so there is no trial to judge",
                where=log.name,
                hint="check that the log covers the whole trial",
            )
        warnings, notes = (
            _warnings_of_system_and_notes(with_states, place.system)
            if place.system
            else (_warnings_of_own_rule(with_states, config.rule), ())
        )
        encounters = _encounter_by_other_vehicle(real, place, log.start_ns)
        trial, encounter = _find_driven_trial_and_encounter(clause, encounters, place)
        result = _check_and_judge_recorded_trial(clause, trial, encounter, warnings, config, place)
    settings = {"log": place.name, **settings_of_clause_run(clause, config)}
    settings.pop("grade", None)  # a recorded trial has its own noise
    if place.system:
        settings = {"log": place.name, "system": place.system} | {
            name: value for name, value in settings.items() if name == "policy"
        }
    trials = tuple(TrialResult(each, (result,) if each is trial else (), 1) for each in clause.trials)
    return ClauseResult(clause, trials, 1, settings, notes)


def judge_log_by_clauses(names: Sequence[str], place: LogTrial, config: ConformConfig) -> list[ClauseResult]:
    """Judge a log by several clauses; one of which it holds no trial is not judged, and its note says why.

    Raises:
        CwcliError: As `judge_log` does; of one clause alone, or of all of them.
    """
    if len(names) == 1:
        return [judge_log(names[0], place, config)]
    results, reasons = [], []
    for name, clause in load_clauses(names).items():
        try:
            if not clause.tolerances:
                raise DataError("it has no tolerances of recorded trials")
            results.append(judge_log(name, place, config))
        except DataError as error:
            reasons.append(f"{name}: not judged: {error.what}")
            trials = tuple(TrialResult(each, (), 1) for each in clause.trials)
            results.append(ClauseResult(clause, trials, 1, {"log": place.name}, (reasons[-1],)))
    if len(reasons) == len(names):
        raise DataError("it holds no trial of the clauses", where=place.name, found=tuple(reasons))
    return results


def _warnings_of_own_rule(log: Log, rule: str) -> tuple[RaisedWarning, ...]:
    """The warnings of cwcli's rule in a log, when they could be known."""
    if WARNINGS.topic not in {channel.topic for channel in log.channels}:
        return ()
    events = warning_events_with_known_start(read_warnings(log.columns(WARNINGS.topic)))
    own = sorted((event.raised_ns, event.other_id) for event in events if event.rule == rule)
    return tuple(RaisedWarning((raised - log.start_ns) / NS_PER_S, other) for raised, other in own)


def _warnings_of_system_and_notes(log: Log, system: str) -> tuple[tuple[RaisedWarning, ...], tuple[str, ...]]:
    """The warnings of another system, by the option `--system`, and what is odd about them."""
    topic, _, condition = system.partition(":")
    if not topic.startswith("/") or not condition:
        raise UsageError(f"--system {system}: expected /topic:field==value", hint=CONDITION_EXAMPLES_HINT)
    flag = read_flag_from_topic(log, topic, parse_condition(condition))
    warnings = tuple(RaisedWarning((raised - log.start_ns) / NS_PER_S) for raised, _ in flag.warning_spans_ns())
    return warnings, flag.notes


def _encounter_by_other_vehicle(real: ActualOutcomes, place: LogTrial, start_ns: int) -> dict[str, Encounter]:
    """The motion of the host and each other vehicle in the trial's window."""
    if place.lead is not None and place.lead not in real.pairs:
        raise UsageError(f"--lead {place.lead}: no such vehicle", found=tuple(real.pairs), hint="name one of these")
    found = {}
    for vehicle, pair in real.pairs.items():
        if place.lead in (None, vehicle):
            encounter = _encounter_of_pair(pair, vehicle, place, start_ns)
            if encounter is not None:
                found[vehicle] = encounter
    return found


def _encounter_of_pair(pair: Pair, vehicle: str, place: LogTrial, start_ns: int) -> Encounter | None:
    """The motion of a pair where both are known; None where that is less than a second."""
    time_s = (pair.stamp_ns - start_ns) / NS_PER_S
    states = np.concatenate([pair.other_states, pair.other_derivatives, np.zeros((len(time_s), 1))], axis=1)
    is_in_window = np.isfinite(states).all(axis=1) & np.isfinite(pair.host.state).all(axis=1)
    is_in_window &= (time_s >= (place.start_s or 0.0)) & (time_s < (math.inf if place.end_s is None else place.end_s))
    rows = np.flatnonzero(is_in_window)
    if len(rows) < 2 or time_s[rows[-1]] - time_s[rows[0]] < 1.0:
        return None
    host, other = pair.host.state[rows].copy(), states[rows]
    host[:, HEADING] = np.unwrap(host[:, HEADING])
    other[:, HEADING] = np.unwrap(other[:, HEADING])
    return Encounter(np.asarray(time_s[rows]), host, other, pair.host_size, pair.other_size, vehicle)


def _find_driven_trial_and_encounter(
    clause: Clause, encounters: Mapping[str, Encounter], place: LogTrial
) -> tuple[Trial, Encounter]:
    """Find which trial of the clause was driven, and with which vehicle.

    Raises:
        DataError: None was.
        MissingSignalError: Several vehicles could be the lead.
    """
    near: list[tuple[float, Trial, Encounter]] = []
    seen: list[str] = []
    for vehicle, encounter in encounters.items():
        for trial in clause.trials:
            if trial.scene not in SCENES_RECOGNISABLE_IN_LOGS:
                continue
            match = match_encounter_with_trial(clause, trial, encounter)
            seen.append(f"{vehicle} as {trial.name}: {match.text}")
            if match.distance <= MAX_SPEED_DIFFERENCE_FROM_TRIAL_IN_TOLERANCES:
                near.append((match.distance, trial, match.encounter))
    if not near:
        raise DataError(
            f"it holds no trial of {clause.name}",
            where=place.name,
            found=tuple(seen) or ("no vehicle is known together with the ego for a second",),
            hint="name the window with --start and --end, or the vehicle with --lead",
        )
    vehicles = list(dict.fromkeys(encounter.other_id for _, _, encounter in near))
    if len(vehicles) > 1:
        raise MissingSignalError(
            "several vehicles could be the lead of the trial",
            where=place.name,
            found=tuple(f"{vehicle}: {_distance_text(encounters[vehicle])}" for vehicle in vehicles),
            hint=f"name one with --lead, for example --lead {vehicles[0]}",
        )
    _, trial, encounter = min(near, key=lambda entry: entry[0])
    return trial, encounter


def _distance_text(encounter: Encounter) -> str:
    """Where a vehicle is at the window's begin, in words."""
    speed_mps = max(float(encounter.other[0, SPEED]), 0.0)  # rather than -0.0
    return f"{encounter.gap_m[0]:.1f} m ahead, {speed_mps:.1f} m/s, at {encounter.time_s[0]:.1f} s"


def _check_and_judge_recorded_trial(
    clause: Clause,
    trial: Trial,
    encounter: Encounter,
    warnings: tuple[RaisedWarning, ...],
    config: ConformConfig,
    place: LogTrial,
) -> Repetition:
    """Check a recorded trial's tolerances, and judge its warnings."""
    onset = clause.tolerance("subject-onset") or DEFAULT_MIN_DECELERATION_OF_HOST_REACTION_MPS2
    begin_s, end_s = encounter.time_s[0], encounter.time_s[-1]
    inside = tuple(each for each in warnings if begin_s <= each.raised_s <= end_s)
    reaction_s = host_braking_onset_or_end_s(encounter, onset)
    whole = continue_without_reaction(encounter, reaction_s)
    driven = DrivenTrial(whole, inside, trial.demands, config.policy or clause.policy)
    try:
        verdict = judge_driven_trial(trial, driven, clause.name)
    except UsageError as error:
        raise DataError(
            f"{trial.name}: its record is too short to judge the warning",
            where=place.name,
            found=(f"both vehicles are known from {begin_s:.2f} to {end_s:.2f} s", *error.found),
            hint="begin the window (--start) earlier",
        ) from error
    latest_s = verdict.values.get("latest_s", math.nan)
    if math.isnan(driven.warned_s) and reaction_s == end_s < latest_s:
        raise DataError(
            f"{trial.name}: its record ends before the warning is due",
            where=place.name,
            found=(f"both vehicles are known until {end_s:.2f} s, and the warning is due at {latest_s:.2f} s",),
            hint="end the window (--end) later, or record the trial to its end",
        )
    breaches = find_tolerance_breaches(
        clause, trial, encounter, checked_start_and_end_s(trial, whole, driven.warned_s, verdict)
    )
    return Repetition(place.name, verdict, tuple(breaches))


def host_braking_onset_or_end_s(encounter: Encounter, onset_mps2: float) -> float:
    """When the host first brakes harder than an onset after the event began; the end of the data if it never does."""
    brakes = (encounter.host[:, ACCEL] < -onset_mps2) & (encounter.time_s >= encounter.event_s)
    rows = np.flatnonzero(brakes)
    return float(encounter.time_s[rows[0]] if len(rows) else encounter.time_s[-1])


def continue_without_reaction(encounter: Encounter, from_s: float) -> Encounter:
    """Return the encounter with both going on from a time: the host at its speed, the other at its acceleration."""
    keep = encounter.time_s <= from_s
    last = int(np.flatnonzero(keep)[-1])
    n = int(MOTION_CONTINUED_WITHOUT_REACTION_S / UNREACTED_MOTION_STEP_S)
    ahead_s: FloatArray = np.arange(1, n + 1, dtype=np.float64) * UNREACTED_MOTION_STEP_S
    host = _straight_motion_states(np.asarray(encounter.host[last]), ahead_s, 0.0)
    other = _straight_motion_states(
        np.asarray(encounter.other[last]), ahead_s, min(float(encounter.other[last, ACCEL]), 0.0)
    )
    return Encounter(
        np.concatenate([encounter.time_s[: last + 1], encounter.time_s[last] + ahead_s]),
        np.concatenate([encounter.host[: last + 1], host]),
        np.concatenate([encounter.other[: last + 1], other]),
        encounter.host_size,
        encounter.other_size,
        encounter.other_id,
        encounter.event_s,
    )


def _straight_motion_states(state: FloatArray, ahead_s: FloatArray, accel_mps2: float) -> FloatArray:
    """The states (k, 8) of a vehicle that goes straight on at an acceleration until it stands."""
    speed = float(state[SPEED])
    moving_s = np.minimum(ahead_s, -speed / accel_mps2) if accel_mps2 < 0.0 else ahead_s
    way_m = speed * moving_s + 0.5 * accel_mps2 * moving_s**2
    out = np.zeros((len(ahead_s), len(state)))
    out[:, X] = state[X] + way_m * math.cos(state[HEADING])
    out[:, Y] = state[Y] + way_m * math.sin(state[HEADING])
    out[:, SPEED] = np.maximum(speed + accel_mps2 * moving_s, 0.0)
    out[:, HEADING] = state[HEADING]
    out[:, ACCEL] = np.where(moving_s < ahead_s, 0.0, accel_mps2)
    return out
