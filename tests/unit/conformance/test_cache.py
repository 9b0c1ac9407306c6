"""A second run does only what is new, and nothing old is used after a change of what a repetition depends on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from cwcli.conformance import run
from cwcli.conformance.cache import RepetitionCache, repetition_key
from cwcli.conformance.clause import load_clause
from cwcli.conformance.results import Repetition
from cwcli.conformance.run import BUILTIN_RULE_NAMES, ConformConfig, run_clauses, run_clauses_with_rules
from cwcli.conformance.verdict import Verdict
from cwcli.errors import UsageError
from cwcli.warning.rules import RULES

CLAUSE = "etsi-101-539"
N_TRIALS = 3


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The trials and seeds that are run, none of them really."""
    calls: list[tuple[int, int]] = []

    def run_trial(
        name: str, index: int, seeds: Sequence[int], config: ConformConfig, rules: Sequence[str]
    ) -> dict[str, tuple[Repetition, ...]]:
        calls.extend((index, seed) for seed in seeds)
        found = tuple(
            Repetition(str(seed), Verdict(0.1 * seed, "s", f"trial {index}", {"ttc_s": math.inf}, seed == 2))
            for seed in seeds
        )
        return dict.fromkeys(rules, found)

    monkeypatch.setattr(run, "run_trial_with_rules", run_trial)
    return calls


def margins(folder: Path, config: ConformConfig) -> list[list[float]]:
    (result,) = run_clauses([CLAUSE], config, cache=RepetitionCache(str(folder)))
    return [[each.verdict.margin for each in trial.repetitions if each.verdict is not None] for trial in result.trials]


def test_a_second_run_does_only_the_new_seeds(tmp_path: Path, driven: list[tuple[int, int]]) -> None:
    first = margins(tmp_path, ConformConfig(2, 1))
    assert driven == [(k, seed) for k in range(N_TRIALS) for seed in range(2)]
    driven.clear()
    assert margins(tmp_path, ConformConfig(2, 1)) == first
    assert driven == []
    more = margins(tmp_path, ConformConfig(4, 1))
    assert driven == [(k, seed) for k in range(N_TRIALS) for seed in (2, 3)]
    assert more == [[0.0, 0.1, 0.2, pytest.approx(0.3)]] * N_TRIALS


@pytest.mark.parametrize(
    "changed",
    [{"rule": "ttc"}, {"horizon_s": 3.0}, {"policy": "full"}, {"grade": "fine"}],
    ids=lambda options: next(iter(options)),
)
def test_another_option_uses_nothing_of_it(
    tmp_path: Path, driven: list[tuple[int, int]], changed: dict[str, object]
) -> None:
    margins(tmp_path, ConformConfig(1, 1))
    driven.clear()
    margins(tmp_path, replace(ConformConfig(1, 1), **changed))  # type: ignore[arg-type]
    assert len(driven) == N_TRIALS


def test_one_more_rule_runs_each_trial_once_and_is_kept_beside_the_first(
    tmp_path: Path, driven: list[tuple[int, int]]
) -> None:
    margins(tmp_path, ConformConfig(1, 1))
    driven.clear()
    cache = RepetitionCache(str(tmp_path))
    found = run_clauses_with_rules([CLAUSE], ConformConfig(1, 1), ("cwcli", "ttc", "path-ttc"), cache=cache)
    assert list(found) == ["cwcli", "ttc", "path-ttc"]
    assert driven == [(k, 0) for k in range(N_TRIALS)]
    driven.clear()
    assert margins(tmp_path, ConformConfig(1, 1, "path-ttc")) == [[0.0]] * N_TRIALS
    assert driven == []


def test_changed_code_uses_nothing_of_it(
    tmp_path: Path, driven: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    margins(tmp_path, ConformConfig(1, 1))
    monkeypatch.setattr("cwcli.conformance.cache.code_and_numpy_hash", lambda: "another")
    driven.clear()
    margins(tmp_path, ConformConfig(1, 1))
    assert len(driven) == N_TRIALS


def test_a_verdict_comes_back_as_it_was_and_a_cut_line_is_run_again(
    tmp_path: Path, driven: list[tuple[int, int]]
) -> None:
    cache = RepetitionCache(str(tmp_path))
    kept = Repetition("7", Verdict(math.nan, "", "no warning", {"warned_s": math.nan, "latest_s": -math.inf}, True))
    cache.add_repetitions([("a", kept), ("b", replace(kept, label="8"))])
    text = cache.path.read_text()
    cache.path.write_text(text[: text.rindex("label")])
    read = RepetitionCache(str(tmp_path))
    assert repr(read.get_repetition("a")) == repr(kept)
    assert read.get_repetition("b") is None


def test_a_plug_in_s_rule_is_never_kept(
    tmp_path: Path, driven: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert set(BUILTIN_RULE_NAMES) == set(RULES._builtin)
    monkeypatch.setattr(run, "BUILTIN_RULE_NAMES", ())
    margins(tmp_path, ConformConfig(1, 1))
    driven.clear()
    margins(tmp_path, ConformConfig(1, 1))
    assert len(driven) == N_TRIALS


def test_keys_differ_between_all_trials_and_seeds() -> None:
    clause = load_clause("un-r152")
    keys = {
        repetition_key(run._cache_key_parts(clause, k, ConformConfig()), seed)
        for k in range(len(clause.trials))
        for seed in range(3)
    }
    assert len(keys) == 3 * len(clause.trials)


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(UsageError, match="can't be used for finished repetitions"):
        RepetitionCache(str(tmp_path / "taken"))
