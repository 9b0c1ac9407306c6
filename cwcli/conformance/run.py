"""Run a clause: every trial simulated, warned of and judged, over all seeds, in several processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from cwcli.conformance.cache import RepetitionCache, repetition_key
from cwcli.conformance.clause import Clause, Trial, load_clause, require_judge_module
from cwcli.conformance.grades import SCENARIO_OVERRIDES_BY_GRADE
from cwcli.conformance.lane_trials import simulate_lane_trial, warn_of_lane_departure
from cwcli.conformance.online import (
    SimulatedTrial,
    Warner,
    build_trial_scenario,
    make_pipeline_warner,
    simulate_trial,
    true_encounter,
)
from cwcli.conformance.policies import NO_BRAKING_POLICY, PEDALS_BY_POLICY
from cwcli.conformance.results import ClauseResult, Repetition, TrialResult
from cwcli.conformance.scenes import SCENES
from cwcli.conformance.verdict import DrivenTrial, Verdict
from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.process_pool import process_pool
from cwcli.warning.rules import DEFAULT_RULE, RULES

Tick = Callable[[str, int, int], None]
BUILTIN_RULE_NAMES = ("cwcli", "song2016", "ttc", "path-ttc", "eebl")
"""The rules of cwcli itself."""
MAX_HORIZON_OPTION_S = 10.0
"""Longest horizon, s. Chosen by hand: no prediction means anything beyond."""
MAX_REPETITIONS_OF_TRIAL = 1000
"""Largest number of repetitions of a trial. Chosen by hand."""


@dataclass(frozen=True)
class ConformConfig:
    """How clauses are run.

    Attributes:
        seeds: Repetitions of each trial, with seeds 0, 1, 2, ...; None: as many as the clause says.
        jobs: Processes; the results do not depend on it.
        horizon_s: How far the paths and the rule look ahead; None: the defaults of `predict` and `warn`.
        policy: Braking policy, or None: the clause's own.
        grade: Grade of noise, or None: the clause's own.
    """

    seeds: int | None = None
    jobs: int = 2
    rule: str = DEFAULT_RULE
    horizon_s: float | None = None
    policy: str | None = None
    grade: str | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            UsageError: A number is out of range, or a name does not exist.
        """
        if self.seeds is not None and not 1 <= self.seeds <= MAX_REPETITIONS_OF_TRIAL:
            raise UsageError(f"--seeds {self.seeds}: permitted are 1 to {MAX_REPETITIONS_OF_TRIAL}")
        if self.jobs < 1:
            raise UsageError(f"--jobs {self.jobs} must be at least 1")
        if self.horizon_s is not None and not 0.5 <= self.horizon_s <= MAX_HORIZON_OPTION_S:
            raise UsageError(f"--horizon {self.horizon_s:g}: permitted are 0.5 to {MAX_HORIZON_OPTION_S:g} s")
        RULES.require(self.rule)
        for option, value, known in (
            ("policy", self.policy, PEDALS_BY_POLICY),
            ("grade", self.grade, SCENARIO_OVERRIDES_BY_GRADE),
        ):
            if value is not None and value not in known:
                raise UsageError(
                    f"there is no {option} {value!r}", hint=hint_at_closest_or_all_known_names(value, known)
                )


def run_clauses(
    names: Sequence[str],
    config: ConformConfig,
    tick: Tick = lambda text, done, total: None,
    cache: RepetitionCache | None = None,
) -> list[ClauseResult]:
    """Run clauses; `tick` is called with a text, and how many trials are done of how many, when one is done.

    Args:
        cache: Repetitions that were run before, which gets the new ones; None: everything is run.

    Raises:
        UsageError: A clause does not exist, is wrong, or has a trial that nobody can drive.
    """
    clauses = {name: load_clause(name) for name in names}
    for name, clause in clauses.items():
        check_trials(clause, name)
    seeds = {name: range(config.seeds or clause.n_repetitions) for name, clause in clauses.items()}
    tasks = [(name, k) for name, clause in clauses.items() for k in range(len(clause.trials))]
    known: dict[tuple[str, int], dict[int, Repetition]] = {}
    for name, k in tasks:
        known[name, k] = _known_repetitions(clauses[name], k, seeds[name], config, cache)
    missing = {task: [seed for seed in seeds[task[0]] if seed not in known[task]] for task in tasks}
    for n_done, ((name, k), found) in enumerate(_run_missing(missing, config), start=1):
        if cache is not None and _is_cacheable(config):
            parts = _cache_key_parts(clauses[name], k, config)
            cache.add_repetitions((repetition_key(parts, int(each.label)), each) for each in found)
        known[name, k] |= {int(each.label): each for each in found}
        tick(f"{name}: {clauses[name].trials[k].name}", n_done, len(tasks))
    return [
        ClauseResult(
            clause,
            tuple(
                TrialResult(
                    trial,
                    tuple(known[name, k][seed] for seed in seeds[name]),
                    clause.required_passes(len(seeds[name])),
                )
                for k, trial in enumerate(clause.trials)
            ),
            len(seeds[name]),
            _settings_of_clause_run(clause, config),
        )
        for name, clause in clauses.items()
    ]


def _run_missing(
    missing: Mapping[tuple[str, int], Sequence[int]], config: ConformConfig
) -> Iterator[tuple[tuple[str, int], list[Repetition]]]:
    """Run the missing seeds of every trial; yields each trial with its new repetitions."""
    n_new = sum(len(seeds) for seeds in missing.values())
    if config.jobs == 1 or n_new <= 1:
        for (name, k), seeds in missing.items():
            yield (name, k), list(run_trial(name, k, seeds, config)) if seeds else []
        return
    with process_pool(config.jobs) as pool:
        running = {
            (name, k): [
                pool.submit(run_trial, name, k, tuple(seeds[part :: config.jobs]), config)
                for part in range(min(config.jobs, len(seeds)))
            ]
            for (name, k), seeds in missing.items()
        }
        for task, parts in running.items():
            yield task, [each for part in parts for each in part.result()]


def _known_repetitions(
    clause: Clause, index: int, seeds: Sequence[int], config: ConformConfig, cache: RepetitionCache | None
) -> dict[int, Repetition]:
    """The repetitions of a trial that were run before, by seed."""
    if cache is None or not _is_cacheable(config):
        return {}
    parts = _cache_key_parts(clause, index, config)
    found = {seed: cache.get_repetition(repetition_key(parts, seed)) for seed in seeds}
    return {seed: each for seed, each in found.items() if each is not None}


def _is_cacheable(config: ConformConfig) -> bool:
    """Whether results depend on cwcli alone: another package's rule can change while its name stays."""
    return config.rule in BUILTIN_RULE_NAMES


def _cache_key_parts(clause: Clause, index: int, config: ConformConfig) -> dict[str, Any]:
    """What the repetitions of a trial depend on, besides the seed and the code."""
    trial = clause.trials[index]
    return {
        **{name: getattr(trial, name) for name in ("scene", "judge", "rule")},
        "given": dict(trial.given),
        "demands": dict(trial.demands),
        "policy": config.policy or clause.policy,
        "grade": config.grade or clause.grade,
        "config": [config.rule, config.horizon_s],
    }


def check_trials(clause: Clause, where: str) -> None:
    """Build every scene once, so that an impossible trial is refused before anything is run.

    Raises:
        UsageError: A trial is impossible.
    """
    for trial in clause.trials:
        build = SCENES[trial.scene].build
        if build is None:
            continue
        try:
            scene = build(trial.given)
            build_trial_scenario(scene, clause.grade, name="trial")
        except UsageError as error:
            raise UsageError(f"{trial.name}: {error.what}", where=where, hint=error.hint) from error


def run_trial(
    clause_name: str, index: int, seeds: Sequence[int], config: ConformConfig, warner: Warner | None = None
) -> tuple[Repetition, ...]:
    """Run one trial of a clause with some seeds, in this process.

    Args:
        warner: The system that is judged, which gets the truth alone; None: cwcli with the rule of the configuration.
    """
    clause = load_clause(clause_name)
    trial = clause.trials[index]
    build = SCENES[trial.scene].build
    policy = config.policy or clause.policy
    if build is None:
        return _run_lane_trial(trial, seeds, policy, clause_name, warner)
    scene = build(trial.given)
    scenario = build_trial_scenario(scene, config.grade or clause.grade, name="trial")
    encounter = true_encounter(scenario, scene)
    own = make_pipeline_warner(trial.rule or config.rule, config.horizon_s)
    found = []
    for seed in seeds:
        if warner is None:
            warnings = own(simulate_trial(scenario, encounter, seed))
        else:
            warnings = warner(SimulatedTrial(None, encounter))
        driven = DrivenTrial(encounter, warnings, trial.demands, policy)
        found.append(Repetition(str(seed), judge_driven_trial(trial, driven, clause_name)))
    return tuple(found)


def _run_lane_trial(
    trial: Trial, seeds: Sequence[int], policy: str, where: str, warner: Warner | None
) -> tuple[Repetition, ...]:
    """Run one trial of leaving the lane; the rule is the lane-departure rule."""
    found = []
    for seed in seeds:
        driven = simulate_lane_trial(trial.given, seed)
        warnings = warn_of_lane_departure(driven) if warner is None else warner(SimulatedTrial(None, driven.drift))
        driven_trial = DrivenTrial(driven.drift, warnings, trial.demands, policy)
        found.append(Repetition(str(seed), judge_driven_trial(trial, driven_trial, where)))
    return tuple(found)


def judge_driven_trial(trial: Trial, driven: DrivenTrial, where: str) -> Verdict:
    """Judge a trial that was driven.

    Raises:
        UsageError: The clause's numbers do not fit the trial.
    """
    judge: Callable[[DrivenTrial], Verdict] = require_judge_module(trial.judge, where).judge
    try:
        return judge(driven)
    except UsageError as error:
        raise UsageError(f"{trial.name}: {error.what}", where=where, found=error.found, hint=error.hint) from error


def _settings_of_clause_run(clause: Clause, config: ConformConfig) -> dict[str, str]:
    """How a clause was run, for the output."""
    horizon = {} if config.horizon_s is None else {"horizon": f"{config.horizon_s:g} s"}
    settings = {"rule": config.rule, **horizon, "grade": config.grade or clause.grade}
    policy = config.policy or clause.policy
    return settings if policy == NO_BRAKING_POLICY else {**settings, "policy": policy}
