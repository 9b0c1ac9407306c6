"""Run a clause: every trial simulated, warned of and judged, over all seeds, in several processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from cwcli.conformance.cache import RepetitionCache, repetition_key
from cwcli.conformance.clause import Clause, Trial, load_clause, load_clauses, require_judge_module
from cwcli.conformance.grades import SCENARIO_OVERRIDES_BY_GRADE
from cwcli.conformance.lane_trials import simulate_lane_trial, warn_of_lane_departure
from cwcli.conformance.online import build_trial_scenario, true_encounter, warn_with_pipeline
from cwcli.conformance.policies import NO_BRAKING_POLICY, PEDALS_BY_POLICY
from cwcli.conformance.results import ClauseResult, Repetition, TrialResult
from cwcli.conformance.scenes import SCENES
from cwcli.conformance.verdict import DrivenTrial, JudgedMotion, RaisedWarning, Verdict
from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.process_pool import process_pool_killed_on_error
from cwcli.simulation.drive import simulate_scenario
from cwcli.warning.rules import DEFAULT_RULE, RULES

Tick = Callable[[str, int, int], None]
Warner = Callable[[JudgedMotion], tuple[RaisedWarning, ...]]
"""A system that warns: it gets the true motion of a trial and returns its warnings."""
MissingRuns = tuple[Sequence[int], Sequence[str]]
"""Seeds and rules of a trial that have to be run."""
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
    """Run clauses with the rule of the configuration, as `run_clauses_with_rules` does."""
    return run_clauses_with_rules(names, config, (config.rule,), tick, cache)[config.rule]


def run_clauses_with_rules(
    names: Sequence[str],
    config: ConformConfig,
    rules: Sequence[str],
    tick: Tick = lambda text, done, total: None,
    cache: RepetitionCache | None = None,
) -> dict[str, list[ClauseResult]]:
    """Run clauses with several rules; every trial is simulated, estimated and predicted once for all of them.

    Args:
        rules: Keys of `warning.rules.RULES`; the rule of the configuration does not count.
        tick: Called with a text, and how many trials are done of how many, when one is done.
        cache: Repetitions that were run before, which gets the new ones; None: everything is run.

    Returns:
        The results by rule.

    Raises:
        UsageError: A clause does not exist, is wrong, or has a trial that nobody can drive.
    """
    clauses = load_clauses(names)
    for name, clause in clauses.items():
        check_trials(clause, name)
    seeds = {name: range(config.seeds or clause.n_repetitions) for name, clause in clauses.items()}
    tasks = [(name, k) for name, clause in clauses.items() for k in range(len(clause.trials))]
    known = {
        (rule, *task): _known_repetitions(clauses[task[0]], task[1], seeds[task[0]], replace(config, rule=rule), cache)
        for task in tasks
        for rule in rules
    }
    missing = {task: _missing_runs(known, task, seeds[task[0]], rules) for task in tasks}
    for n_done, ((name, k), found_by_rule) in enumerate(_run_missing_seeds_of_trials(missing, config), start=1):
        for rule, found in found_by_rule.items():
            with_rule = replace(config, rule=rule)
            if cache is not None and _is_cacheable(with_rule):
                parts = _cache_key_parts(clauses[name], k, with_rule)
                cache.add_repetitions((repetition_key(parts, int(each.label)), each) for each in found)
            known[rule, name, k] |= {int(each.label): each for each in found}
        tick(f"{name}: {clauses[name].trials[k].name}", n_done, len(tasks))
    return {
        rule: [
            ClauseResult(
                clause,
                tuple(
                    TrialResult(
                        trial,
                        tuple(known[rule, name, k][seed] for seed in seeds[name]),
                        clause.required_passes(len(seeds[name])),
                    )
                    for k, trial in enumerate(clause.trials)
                ),
                len(seeds[name]),
                settings_of_clause_run(clause, replace(config, rule=rule)),
            )
            for name, clause in clauses.items()
        ]
        for rule in rules
    }


def _missing_runs(
    known_repetitions: Mapping[tuple[str, str, int], Mapping[int, Repetition]],
    task: tuple[str, int],
    seeds: Sequence[int],
    rules: Sequence[str],
) -> MissingRuns:
    """The seeds of a trial that some rule lacks, and the rules that lack one."""
    lacking = {rule: [seed for seed in seeds if seed not in known_repetitions[rule, *task]] for rule in rules}
    missing = {seed for of_rule in lacking.values() for seed in of_rule}
    return [seed for seed in seeds if seed in missing], [rule for rule in rules if lacking[rule]]


def _run_missing_seeds_of_trials(
    missing: Mapping[tuple[str, int], MissingRuns], config: ConformConfig
) -> Iterator[tuple[tuple[str, int], dict[str, list[Repetition]]]]:
    """Run the missing seeds of every trial; yields each trial with its new repetitions by rule."""
    n_new = sum(len(seeds) for seeds, _ in missing.values())
    if config.jobs == 1 or n_new <= 1:
        for (name, k), (seeds, rules) in missing.items():
            yield (name, k), _merge_by_rule(run_trial_with_rules(name, k, seeds, config, rules) if seeds else {})
        return
    with process_pool_killed_on_error(config.jobs) as pool:
        running = {
            (name, k): [
                pool.submit(run_trial_with_rules, name, k, tuple(seeds[part :: config.jobs]), config, rules)
                for part in range(min(config.jobs, len(seeds)))
            ]
            for (name, k), (seeds, rules) in missing.items()
        }
        for task, parts in running.items():
            yield task, _merge_by_rule(*(part.result() for part in parts))


def _merge_by_rule(*parts: Mapping[str, Sequence[Repetition]]) -> dict[str, list[Repetition]]:
    """The repetitions of several parts of a trial, by rule."""
    return {rule: [each for part in parts for each in part[rule]] for rule in (parts[0] if parts else {})}


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
    return run_trial_with_rules(clause_name, index, seeds, config, (config.rule,), warner)[config.rule]


def run_trial_with_rules(
    clause_name: str,
    index: int,
    seeds: Sequence[int],
    config: ConformConfig,
    rules: Sequence[str],
    warner: Warner | None = None,
) -> dict[str, tuple[Repetition, ...]]:
    """Run one trial of a clause with some seeds and rules, in this process; return the repetitions by rule.

    Args:
        warner: As of `run_trial`; it stands for every rule.
    """
    clause = load_clause(clause_name)
    trial = clause.trials[index]
    policy = config.policy or clause.policy
    judged_rules = (trial.rule,) if trial.rule else tuple(rules)
    found: dict[str, list[Repetition]] = {rule: [] for rule in judged_rules}
    drives = _motions_and_warnings(trial, seeds, config, judged_rules, config.grade or clause.grade, warner)
    for seed, (motion, warnings) in zip(seeds, drives, strict=True):
        for rule in judged_rules:
            driven = DrivenTrial(motion, warnings[rule], trial.demands, policy)
            found[rule].append(Repetition(str(seed), judge_driven_trial(trial, driven, clause_name)))
    return {rule: tuple(found[trial.rule or rule]) for rule in rules}


def _motions_and_warnings(
    trial: Trial, seeds: Sequence[int], config: ConformConfig, rules: Sequence[str], grade: str, warner: Warner | None
) -> Iterator[tuple[JudgedMotion, dict[str, tuple[RaisedWarning, ...]]]]:
    """The motion of a trial with each seed, and its warnings by rule; the rule in a lane is that of lane departure."""
    build = SCENES[trial.scene].build
    if build is None:
        for seed in seeds:
            driven = simulate_lane_trial(trial.given, seed)
            warnings = warn_of_lane_departure(driven) if warner is None else warner(driven.drift)
            yield driven.drift, dict.fromkeys(rules, warnings)
        return
    scene = build(trial.given)
    scenario = build_trial_scenario(scene, grade, name="trial")
    encounter = true_encounter(scenario, scene)
    for seed in seeds:
        if warner is not None:
            yield encounter, dict.fromkeys(rules, warner(encounter))
        else:
            yield encounter, warn_with_pipeline(simulate_scenario(scenario, seed), rules, config.horizon_s)


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


def settings_of_clause_run(clause: Clause, config: ConformConfig) -> dict[str, str]:
    """The settings that the trials of a clause depend on, for the output; drives in a lane have their own."""
    if all(trial.rule for trial in clause.trials):
        return {"rule": ", ".join(sorted({trial.rule for trial in clause.trials}))}
    horizon = {} if config.horizon_s is None else {"horizon": f"{config.horizon_s:g} s"}
    settings = {"rule": config.rule, **horizon, "grade": config.grade or clause.grade}
    policy = config.policy or clause.policy
    is_used = any(
        getattr(require_judge_module(each.judge, clause.name), "VERDICT_DEPENDS_ON_BRAKING_POLICY", False)
        for each in clause.trials
    )
    return {**settings, "policy": policy} if is_used and policy != NO_BRAKING_POLICY else settings
