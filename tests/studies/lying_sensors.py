"""Is a sensor that lies found out? `python -m tests.studies.lying_sensors [--faults] [--seeds N] [--scenarios]`.

Each fault of `sensor_faults` is put into simulated drives, full (fix, heading, speed, IMU) and lean (fix, IMU). Told
are the position's error beside that of the drive without the fault, whether source and fault are named, and the NEES
beside the verdict. A case is good where the error is within HARMLESS of the fault-free one, or source and fault are
named; and bad in any case where the verdict finds no fault with a NEES above MAX_NEES. A drift of the fixes may also be
excepted by the verdict, as what the sources do not show. `--quiet` runs the whole estimate of drives without a fault and
of the logs of `--logs` instead: nothing may be corrected or named there. The exit code is 1 where less than MIN_SHARE of
the cases is good, a verdict is wrong, or something is corrected without a fault.

`--kept-aside` runs those faults that were kept aside; without it they are left out. `--results FILE` adds each case to a
file of JSON lines, and cases that it has are not run again: so the study can be stopped and go on.

What the estimate takes of the sources, after corrections and the vote, is often the same for two faults: all units of a
speed are converted to the same values, and a source that is left out is left out however it is wrong. It is estimated
once (`Estimates`).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections import defaultdict
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from cwcli.errors import CwcliError
from cwcli.estimation import EstimatorConfig, Kind, Measurements, Track, estimate_track
from cwcli.estimation.measurements import KINDS_THAT_IMU_MEASURES_TOO
from cwcli.estimation.prepare import clean_and_sort_measurements_and_note, earliest_stamp_ns
from cwcli.estimation.source_clocks import align_source_clocks_and_note
from cwcli.estimation.source_judgement import JudgedSources, judge_sources
from cwcli.estimation.summary import summarise_track
from cwcli.estimation.verdict import consistency_verdict_sentence
from cwcli.logs.read.reader import Log
from cwcli.signals.role import Role
from cwcli.simulation.catalogue import scenario_names
from cwcli.simulation.drive import SimulatedDrive, simulate_scenario
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, load_scenario
from cwcli.stages.estimate import EGO_SENSOR_ROLES, _collect_ego_measurements, _map_at_first_fix_unless_cartesian
from cwcli.stages.inputs.sources import SourceConfig, read_sensor_signals
from tests.studies import sensor_faults
from tests.studies.sensor_faults import (
    FAULTS,
    LATER_FAULTS,
    RECEIVER_FAULTS,
    ROAD_FAULTS,
    SOFTWARE_FAULTS,
    VEHICLE_FAULTS,
    Fault,
)
from tests.studies.sensor_model import measurements_of
from tests.drive_truth import true_states_of_vehicle, truth_stamps_ns

LEAN = (Kind.POSITION, Kind.IMU)
DOUBT_WORDS = "for long, and scatters"
"""Words of a doubt about all sources; it names one only where there are two."""
TOLD_WORDS = (
    "stuck",
    "saturat",
    "stamps are cut",
    "rounded",
    "a copy of",
    "antenna",
    "interpolated",
    "repeat",
    "clock",
    DOUBT_WORDS,
)
"""Words of notes that name a fault of a source."""
FIRST_SEED = 9301
HARMLESS, MAX_NEES, MIN_SHARE = 1.2, 4.0, 0.95
SCENARIOS = {
    "city": ("city", ()),
    "phone": ("phone", ()),
    "curve": ("curve", ()),
    "city-coarse": ("city", ("sensors.gnss.rate_hz=1", "sensors.gnss.sigma_m=1.5", "sensors.imu.rate_hz=50")),
}
"""Name -> scenario and what is changed in it."""


@dataclass(frozen=True)
class Case:
    """One fault in one drive.

    Attributes:
        ratio: Error of the position over that without the fault.
        is_named: Source and fault are told.
        nees: Of the position, per degree of freedom.
        verdict, told: What the user reads.
        is_drift: The fault is a drift of the fixes, which the verdict may except.
        is_unchecked: The verdict may say that the log is too short to check the wrong source.
    """

    ratio: float
    is_named: bool
    nees: float
    verdict: str
    told: str
    is_drift: bool = False
    is_unchecked: bool = False

    @property
    def is_good(self) -> bool:
        """Harmless or named."""
        return self.ratio <= HARMLESS or self.is_named

    @property
    def has_wrong_verdict(self) -> bool:
        """No fault is found although the errors are far larger than their sigma, and the verdict does not except it."""
        finds_no_fault = ["consistent"]
        if not self.is_drift:
            finds_no_fault += ["no contradiction"] + ["too short to check"] * (not self.is_unchecked)
        return self.verdict.startswith(tuple(finds_no_fault)) and self.nees > MAX_NEES


def variants(measurements: Sequence[Measurements]) -> dict[str, list[Measurements]]:
    """All sensors, and fixes with an IMU alone."""
    return {"full": list(measurements), "lean": [m for m in measurements if m.kind in LEAN]}


def simulated(name: str, seed: int) -> SimulatedDrive:
    """A drive of a scenario of `SCENARIOS`, or of the catalogue."""
    scenario, overrides = SCENARIOS.get(name, (name, ()))
    return simulate_scenario(load_scenario(scenario, overrides), seed)


def judged(measurements: Sequence[Measurements]) -> JudgedSources:
    """What the vote says, without an estimate."""
    aligned, notes = align_source_clocks_and_note(measurements)
    epoch = earliest_stamp_ns(aligned)
    found = judge_sources(aligned, lambda current: clean_and_sort_measurements_and_note(current, epoch))
    return replace(found, notes=[*notes, *found.notes])


def used_of(found: JudgedSources) -> Hashable:
    """What the estimate takes of judged sources: equal where it is the same but for the last digits of numbers."""
    digest = hashlib.sha256()
    for p in found.prepared:
        s = p.series
        digest.update(repr((s.source, s.kind, len(s), s.noise_origin, round(s.floor, 9), s.coarse_steps_m)).encode())
        for column in (s.time_s, s.values, s.noise):
            digest.update((np.round(column, 8) + 0.0).tobytes())
    return digest.hexdigest(), tuple((c.who, c.against, c.left_out) for c in found.contradictions)


@dataclass
class Estimates:
    """Estimates of one drive with different faults.

    Attributes:
        drive: The drive.
        known: What the estimate takes of the sources and the point ahead -> its error (m), its NEES per degree of
            freedom, what was judged, and the track.
    """

    drive: SimulatedDrive
    known: dict[Hashable, tuple[float, float, JudgedSources, Track]] = field(default_factory=dict)

    def of(self, measurements: Sequence[Measurements], ahead_m: float = 0.0) -> tuple[float, float, Track]:
        """Return error, NEES and track as `estimated` does; the texts are those of these measurements."""
        own = judged(measurements)
        key = used_of(own), ahead_m
        if key not in self.known:
            error_m, nees, track = estimated(self.drive, measurements, ahead_m)
            self.known[key] = error_m, nees, own, track
            return error_m, nees, track
        error_m, nees, other, track = self.known[key]
        found_later = [each for each in track.contradictions if each not in other.contradictions]
        notes_later = [each for each in track.notes if each not in other.notes]
        return (
            error_m,
            nees,
            replace(
                track,
                corrections=own.corrections,
                contradictions=(*own.contradictions, *found_later),
                notes=(*own.notes, *notes_later),
            ),
        )


def estimated(
    drive: SimulatedDrive, measurements: Sequence[Measurements], ahead_m: float = 0.0
) -> tuple[float, float, Track]:
    """The root mean square error (m) and NEES per degree of freedom of a point ahead of the true one, and the track."""
    stamp_ns = truth_stamps_ns(drive)[::50]
    track = estimate_track(measurements, EstimatorConfig(), stamp_ns)
    true = true_states_of_vehicle(drive, EGO_VEHICLE_KEY)[::50]
    error = track.state[:, :2] - true[:, :2] - ahead_m * np.column_stack([np.cos(true[:, 3]), np.sin(true[:, 3])])
    squared = np.einsum("ni,nij,nj->n", error, np.linalg.inv(track.covariance[:, :2, :2]), error)
    return float(np.sqrt((error**2).sum(axis=1).mean())), float(squared.mean()) / 2.0, track


def told_of(track: Track) -> list[str]:
    """What the user is told of sources: corrections and contradictions first, then what was left out."""
    return [
        *(each.sentence_on_fault_and_undoing for each in track.corrections),
        *(each.contradiction_sentence for each in track.contradictions),
        *(note for note in track.notes if any(word in note for word in TOLD_WORDS)),
    ]


def is_named(fault: Fault, track: Track) -> bool:
    """Whether a sentence that blames the right source has a word of the fault; of two alone both may be blamed."""
    topics = {Kind.SPEED: ("speed",), Kind.IMU: ("imu",), Kind.HEADING: ("heading",),
              Kind.POSITION: ("gnss)", "gnss:", "gnss_copy:", "map of gnss")}  # fmt: skip
    doubts = [note for note in track.notes if DOUBT_WORDS in note]
    if len({r.source for r in track.sources if r.n_used}) > 2:
        track = replace(track, notes=tuple(note for note in track.notes if note not in doubts))
    of_two = [c for c in track.contradictions if "no third source tells" in c.votes_and_left_out_sources_text]
    if of_two and fault.kind in (Kind.POSITION, Kind.IMU):
        return any(topic in str(who) for c in of_two for who in (c.who, c.against) for topic in topics[fault.kind])
    blamed = [each.split(" contradicts ")[0] for each in told_of(track)]
    return any(
        any(topic in who for topic in topics[fault.kind]) and any(word in sentence for word in fault.words)
        for who, sentence in zip(blamed, told_of(track), strict=True)
    )


def is_unchecked(fault: Fault, track: Track) -> bool:
    """Whether the verdict says that no other source confirms the wrong one."""
    kinds = KINDS_THAT_IMU_MEASURES_TOO if fault.kind is Kind.IMU else (fault.kind,)
    return any(r.kind in kinds and r.n_used and not r.is_checked for r in track.sources)


def run_fault(drive: SimulatedDrive, right: Sequence[Measurements], fault: Fault, least_m: float) -> Case:
    """Put a fault into a drive and estimate it."""
    return _case_of_fault(Estimates(drive), right, fault, least_m)


def _case_of_fault(estimates: Estimates, right: Sequence[Measurements], fault: Fault, least_m: float) -> Case:
    true = true_states_of_vehicle(estimates.drive, EGO_VEHICLE_KEY)[::50]
    time_s = 0.05 * np.arange(len(true))
    sensor_faults.STANDING_SPEED[:] = [time_s, np.abs(true[:, 2])]
    sensor_faults.TRUE_HEADING[:] = [time_s, true[:, 3]]
    error_m, nees, track = estimates.of(fault.apply(right), fault.ahead_m)
    verdict = consistency_verdict_sentence(summarise_track(track))
    return Case(error_m / least_m, is_named(fault, track), nees, verdict, "; ".join(told_of(track)),
                fault.is_drift, is_unchecked(fault, track))  # fmt: skip


@dataclass
class KnownCases:
    """Cases in a file of JSON lines, to which new ones are added; without a file they are forgotten."""

    path: Path | None
    cases: dict[tuple[str, str, str], Case] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Read the file."""
        if self.path is not None and self.path.exists():
            for line in self.path.read_text().splitlines():
                (*key, case) = json.loads(line)
                self.cases[key[0], key[1], key[2]] = Case(**case)

    def add(self, key: tuple[str, str, str], case: Case) -> None:
        """Add a case."""
        self.cases[key] = case
        if self.path is not None:
            with self.path.open("a") as file:
                file.write(json.dumps([*key, asdict(case)]) + "\n")


def iter_cases(
    scenarios: Sequence[str], seeds: Sequence[int], faults: Sequence[Fault], known: KnownCases
) -> Iterator[tuple[str, str, Fault, Case]]:
    """Yield drive, variant, fault and case."""
    for seed in seeds:
        for name in scenarios:
            drive = simulated(name, seed)
            for variant, right in variants(measurements_of(drive)).items():
                estimates, least_m = Estimates(drive), float("nan")
                for fault in faults:
                    key = f"{name} {seed}", variant, fault.name
                    if not any(m.kind is fault.kind for m in right):
                        continue
                    if key not in known.cases:
                        if not estimates.known:
                            least_m, _, _ = estimates.of(right)
                        known.add(key, _case_of_fault(estimates, right, fault, least_m))
                    yield key[0], variant, fault, known.cases[key]


def check_faults(
    scenarios: Sequence[str], seeds: Sequence[int], faults: Sequence[Fault], known: KnownCases, *, is_wordy: bool
) -> bool:
    """Print a line for each fault and each scenario; whether enough cases are good, and no verdict is wrong."""
    by_fault: dict[str, list[Case]] = defaultdict(list)
    by_scenario: dict[str, list[Case]] = defaultdict(list)
    for drive, variant, fault, case in iter_cases(scenarios, seeds, faults, known):
        by_fault[fault.name].append(case)
        by_scenario[f"{drive.split()[0]} {variant}"].append(case)
        if is_wordy or not case.is_good or case.has_wrong_verdict:
            mark = "ok" if case.is_good and not case.has_wrong_verdict else "BAD"
            print(f"{mark} {drive} {variant} {fault.name}: {case.ratio:.2f} x, NEES {case.nees:.1f}, {case.told or 'nothing'}"
                  f" | {case.verdict[:120]}", flush=True)  # fmt: skip
    print("| fault | cases | good | named | error, median and most | wrong verdicts |\n|---|---|---|---|---|---|")
    for name, cases in by_fault.items():
        ratios = [case.ratio for case in cases]
        print(f"| {name} | {len(cases)} | {sum(c.is_good for c in cases)} | {sum(c.is_named for c in cases)} | "
              f"{np.median(ratios):.2f}, {max(ratios):.2f} | {sum(c.has_wrong_verdict for c in cases)} |")  # fmt: skip
    for name, cases in by_scenario.items():
        print(f"{name}: {sum(c.is_good for c in cases)} of {len(cases)} good, "
              f"{sum(c.has_wrong_verdict for c in cases)} wrong verdicts")  # fmt: skip
    every = [case for cases in by_fault.values() for case in cases]
    n_good, n_wrong = sum(c.is_good for c in every), sum(c.has_wrong_verdict for c in every)
    print(f"{n_good} of {len(every)} good ({100 * n_good / max(len(every), 1):.1f} %), {n_wrong} wrong verdicts")
    return n_good >= MIN_SHARE * len(every) and not n_wrong


def read_log(path: Path) -> list[Measurements]:
    """The ego's measurements of a log, as `cwcli estimate` takes them; none where it has no position."""
    with Log.open(path) as log:
        try:
            sources = read_sensor_signals(
                log, SourceConfig(), command="estimate", required=(Role.EGO_POSITION,), optional=EGO_SENSOR_ROLES[1:]
            )
        except CwcliError:
            return []
        return _collect_ego_measurements(sources, _map_at_first_fix_unless_cartesian(sources), {})


def check_without_fault(scenarios: Sequence[str], seeds: Sequence[int], logs: Sequence[Path]) -> bool:
    """Whether the whole estimate corrects, names and leaves out nothing in any drive without a fault."""
    n, n_corrected, n_named, n_left_out = 0, 0, 0, 0
    drives = ((f"{name} {seed}", measurements_of(simulated(name, seed))) for seed in seeds for name in scenarios)
    for title, measurements in (*drives, *((path.name, read_log(path)) for path in logs)):
        for variant, own in variants(measurements).items():
            if not any(m.kind is Kind.POSITION and len(m) for m in own):
                continue
            n += 1
            track = estimate_track(own, EstimatorConfig())
            n_corrected += len(track.corrections)
            n_named += len(track.contradictions)
            n_left_out += sum(bool(each.left_out) for each in track.contradictions)
            for sentence in (
                *(each.sentence_on_fault_and_undoing for each in track.corrections),
                *(
                    f"{each.contradiction_sentence}; {each.votes_and_left_out_sources_text}"
                    for each in track.contradictions
                ),
            ):
                print(f"{title} {variant}: {sentence}", flush=True)
    print(f"without a fault: {n_corrected} corrected, {n_named} named, {n_left_out} left out in {n} drives")
    return not n_corrected and not n_named


def main() -> None:
    """Print the tables; exit code 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--faults", nargs="*", default=[], help="Those with this in their name.")
    parser.add_argument("--scenarios", nargs="*", default=list(SCENARIOS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--kept-aside", action="store_true", help="The faults that were kept aside alone.")
    parser.add_argument("--quiet", action="store_true", help="Drives without a fault alone.")
    parser.add_argument("--logs", type=Path, nargs="*", default=[])
    parser.add_argument("--results", type=Path, help="File of JSON lines that holds the cases that were run.")
    parser.add_argument("--wordy", action="store_true", help="A line for each case.")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    if options.quiet:
        every = options.scenarios if options.scenarios != list(SCENARIOS) else [*SCENARIOS, *scenario_names()]
        sys.exit(0 if check_without_fault(list(dict.fromkeys(every)), seeds, options.logs) else 1)
    chosen = [
        fault
        for fault in (*FAULTS, *LATER_FAULTS, *ROAD_FAULTS, *SOFTWARE_FAULTS, *VEHICLE_FAULTS, *RECEIVER_FAULTS)
        if fault.is_kept_aside is options.kept_aside
        and (not options.faults or any(part in fault.name for part in options.faults))
    ]
    sys.exit(
        0 if check_faults(options.scenarios, seeds, chosen, KnownCases(options.results), is_wordy=options.wordy) else 1
    )


if __name__ == "__main__":
    main()
