"""Clauses: the published numbers of one standard, `clauses/NAME.toml`, and the trials that follow from them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import field
from functools import cache
from importlib import import_module
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.input import is_file, read_file
from cwcli.lazy_dataclass import dataclass
from cwcli.registry import bundled_file_stems
from cwcli.signals.units import STANDARD_GRAVITY_MPS2
from cwcli.text import format_count
from cwcli.toml_text import parse_toml

SI_PER_UNIT = {
    "": 1.0,
    "s": 1.0,
    "m": 1.0,
    "m/s": 1.0,
    "km/h": 1.0 / 3.6,
    "mph": 0.44704,
    "m/s^2": 1.0,
    "g": STANDARD_GRAVITY_MPS2,
}
"""Unit of a number in a clause -> its size in SI units."""
LARGEST_NUMBER_BY_UNIT = {
    "s": 60.0,
    "m": 500.0,
    "m/s": 70.0,
    "km/h": 252.0,
    "mph": 156.0,
    "m/s^2": 15.0,
    "g": 1.5,
    "": 1e6,
}
"""Unit -> the largest number that is possible in a trial with road vehicles. Chosen by hand: what the simulation can
drive (`cwcli.simulation.spec`)."""
UNITS_BY_SI_UNIT = {"m/s": ("m/s", "km/h", "mph"), "m": ("m",), "s": ("s",), "m/s^2": ("m/s^2", "g"), "": ("",)}
"""SI unit of a number -> the units in which a file can give it."""
SI_UNIT_BY_WORD = {
    "speed": "m/s",
    "rate": "m/s",
    "deceleration": "m/s^2",
    "time": "s",
    "ttc": "s",
    "gap": "m",
    "offset": "m",
    "radius": "m",
    "length": "m",
    "width": "m",
    "clearance": "m",
    "outside": "m",
    "slow": "m",
    "fast": "m",
    "contact": "",
    "r157": "",
}
"""First or last word of the name of what a trial is given or demands -> its SI unit; "" of what is 0 or 1."""
LARGEST_TOLERANCE_AND_UNIT = {
    "subject-speed": (5.0, "m/s"),
    "other-speed": (5.0, "m/s"),
    "lateral-offset": (2.0, "m"),
    "gap": (20.0, "m"),
    "lead-deceleration": (5.0, "m/s^2"),
    "subject-onset": (5.0, "m/s^2"),
    "lead-onset": (5.0, "m/s^2"),
}
"""Tolerance of recorded trials (`cwcli.conformance.validity`) -> the largest one that a file can give, and its unit.
Chosen by hand: several times the published ones; beyond them any drive would be a valid trial."""
TRIAL_INPUT_NAMES_THAT_MUST_BE_POSITIVE = (
    "host_speed",
    "gap",
    "deceleration",
    "ramp_time",
    "approach_time",
    "lane_change_time",
)
"""Names of what a trial can be given that can't be 0."""
TEXT_BY_BASIS_OF_CLAUSE_NUMBER = {
    "read": "as published",
    "memory": "as commonly stated, not checked",
    "own": "chosen here",
}
"""Basis of a number -> its words in the output: it was read in its source, it is commonly stated but was not checked
there, or it is a choice of this project that the source leaves open."""
CHOICE_TEXT = "choice of cwcli"
"""Words behind a number that is in no standard, and in place of its page."""
NUMBERS_AS_PUBLISHED_TEXT = "numbers as published"
"""Words of every output about the clauses: their numbers are the published ones, and nothing is certified."""
MEANING_BY_TTC_DEFINITION = {
    "constant velocities": "gap over closing speed",
    "constant accelerations": "time until the gap is closed at the present accelerations",
    "": "does not apply",
}
"""Definitions of the time to collision that a number can refer to."""
CLAUSE_KEYS = {
    "title",
    "source",
    "reading",
    "repetitions",
    "grade",
    "policy",
    "numbers",
    "tolerances",
    "trials",
    "left_out",
}
NUMBER_KEYS = {"value", "unit", "source", "page", "basis", "ttc"}
TRIAL_KEYS = {"name", "scene", "judge", "given", "demands", "combine", "rule"}
"""The keys that the tables of a clause's file may have."""
CLAUSE_SUFFIX = ".toml"
"""File name ending of clauses."""
MAX_TRIALS_OF_CLAUSE = 200
"""Largest number of trials of a clause. Chosen by hand: the largest published grid has about 100."""


@dataclass(frozen=True)
class PublishedNumber:
    """A number of a clause, or a list of them for several trials.

    Attributes:
        values: As printed, in `unit`.
        unit: A key of `SI_PER_UNIT`.
        source, page: Where it is printed; the page or section, "" where it is not known.
        basis: A key of `TEXT_BY_BASIS_OF_CLAUSE_NUMBER`.
        ttc: A key of `MEANING_BY_TTC_DEFINITION`: how the source defines the time to collision that the number is.
    """

    name: str
    values: tuple[float, ...]
    unit: str
    source: str
    page: str
    basis: str
    ttc: str = ""

    @property
    def values_in_si_units(self) -> tuple[float, ...]:
        """The values in SI units."""
        return tuple(value * SI_PER_UNIT[self.unit] for value in self.values)

    @property
    def page_text(self) -> str:
        """The page or section, or why there is none."""
        return self.page or (CHOICE_TEXT if self.basis == "own" else "not known")

    @property
    def text(self) -> str:
        """The values with their unit."""
        return f"{', '.join(f'{value:g}' for value in self.values)} {self.unit}".rstrip()


@dataclass(frozen=True)
class Trial:
    """One trial.

    Attributes:
        name: Unique in the clause.
        scene: A key of `scenes.SCENES`.
        judge: Name of a module in `cwcli.conformance.judges`.
        given: What the scene is built from, SI units.
        demands: What the judge asks for, SI units.
        rule: Warning rule that the trial is about; "" is the one that the user chose.
        demands_text: The demands in words, in the units of the file.
    """

    name: str
    scene: str
    judge: str
    given: Mapping[str, float]
    demands: Mapping[str, float]
    rule: str = ""
    demands_text: str = ""


@dataclass(frozen=True)
class Clause:
    """A family of trials of one standard.

    Attributes:
        title, source: What it is, and where its numbers are published.
        reading: How its numbers are read where the source leaves a choice; "" if it leaves none.
        n_repetitions, n_required: Repetitions of each trial, and how many of them must pass.
        grade: Default grade of noise, a key of `grades.SCENARIO_OVERRIDES_BY_GRADE`.
        policy: Default braking policy, a key of `policies.PEDALS_BY_POLICY`.
        numbers: Of the trials, by name.
        tolerances: Within which a recorded trial is valid, by name.
        left_out: Trials of the standard that are not judged here, with the reason.
    """

    name: str
    title: str
    source: str
    reading: str
    n_repetitions: int
    n_required: int
    grade: str
    policy: str
    numbers: Mapping[str, PublishedNumber]
    tolerances: Mapping[str, PublishedNumber]
    trials: tuple[Trial, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)

    def required_passes(self, n_repetitions: int) -> int:
        """Return how many of n repetitions must pass: the same share as published, rounded up."""
        return math.ceil(n_repetitions * self.n_required / self.n_repetitions - 1e-9)

    @property
    def n_unchecked_numbers(self) -> int:
        """Number of numbers that were not checked in their source."""
        return sum(number.basis == "memory" for number in (*self.numbers.values(), *self.tolerances.values()))

    @property
    def n_chosen_numbers(self) -> int:
        """Number of numbers that are a choice of cwcli's, and so in no standard."""
        return sum(number.basis == "own" for number in (*self.numbers.values(), *self.tolerances.values()))

    @property
    def basis_text(self) -> str:
        """What the numbers of the trials are, in a few words: published ones only if one was read in its source."""
        bases = {number.basis for number in self.numbers.values()}
        if "read" in bases:
            return NUMBERS_AS_PUBLISHED_TEXT
        return "numbers as commonly stated" if "memory" in bases else "numbers chosen here"

    @property
    def unchecked_text(self) -> str:
        """How many numbers were not read in their source, in words; "" if all were."""
        return format_unchecked_numbers(self.n_unchecked_numbers, self.n_chosen_numbers)

    def tolerance(self, name: str) -> float | None:
        """A tolerance in SI units; None where the clause has none."""
        return self.tolerances[name].values_in_si_units[0] if name in self.tolerances else None


def format_unchecked_numbers(n: int, n_chosen: int) -> str:
    """Format how many numbers were not checked in their source, and how many have none; "" for none."""
    unchecked = f"{format_count(n, 'number')} as commonly stated, not checked in the standard" if n else ""
    chosen = f"{n_chosen if n else format_count(n_chosen, 'number')} chosen here" if n_chosen else ""
    return "; ".join(filter(None, (unchecked, chosen)))


def clause_names() -> tuple[str, ...]:
    """Names of the clauses that come with cwcli."""
    return bundled_file_stems("cwcli.conformance", "clauses", CLAUSE_SUFFIX)


@cache
def load_clause(name_or_path: str) -> Clause:
    """Load a clause by its name, or from a file of the user's.

    Raises:
        UsageError: There is no such clause (the message names the closest one), or its content is wrong.
    """
    if name_or_path in clause_names():
        name = name_or_path
        text = (files("cwcli.conformance") / "clauses" / f"{name}{CLAUSE_SUFFIX}").read_text(encoding="utf-8")
    elif is_file(name_or_path):
        name = Path(name_or_path).name.removesuffix(CLAUSE_SUFFIX)
        try:
            text = read_file(Path(name_or_path)).decode()
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"can't be read: {error}", where=name_or_path) from error
    else:
        raise UsageError(
            f"there is no clause {name_or_path!r}",
            hint=hint_at_closest_or_all_known_names(name_or_path, clause_names(), "clauses"),
        )
    try:
        document = parse_toml(text)
    except ValueError as error:
        raise UsageError(f"not TOML: {error}", where=f"{name}{CLAUSE_SUFFIX}") from error
    return parse_clause(document, name)


def load_clauses(names_or_paths: Sequence[str]) -> dict[str, Clause]:
    """Load clauses, by the names and paths that they were asked for by.

    Raises:
        UsageError: As of `load_clause`; or two have one name, by which no output could tell them apart.
    """
    clauses = {each: load_clause(each) for each in names_or_paths}
    path_by_name: dict[str, str] = {}
    for path, clause in clauses.items():
        if path_by_name.setdefault(clause.name, path) != path:
            found = (path_by_name[clause.name], path)
            raise UsageError(f"two clauses are called {clause.name}", found=found, hint="rename one of the files")
    return clauses


def parse_clause(document: Mapping[str, Any], name: str) -> Clause:
    """Check the content of a clause's file.

    Raises:
        UsageError: A key is unknown or missing, a number is impossible, or a name is not defined.
    """
    where = f"{name}{CLAUSE_SUFFIX}"
    _check_texts_are_printable({**document, "the file's name": name}, "", where)
    _check_keys(document, CLAUSE_KEYS, {"title", "source", "repetitions", "numbers", "trials"}, "", where)
    numbers = {
        key: _parse_number(key, table, where) for key, table in _table_or_empty(document, "numbers", where).items()
    }
    tolerances = {
        key: _parse_number(key, table, where, place="tolerances")
        for key, table in _table_or_empty(document, "tolerances", where).items()
    }
    _check_tolerances(tolerances, where)
    tables, left_out = document["trials"], _table_or_empty(document, "left_out", where)
    if not isinstance(tables, list):
        raise UsageError(f"trials is {tables!r}; permitted: tables [[trials]]", where=where)
    trials = [trial for table in tables for trial in _parse_trials(table, numbers, where)]
    if not 0 < len(trials) <= MAX_TRIALS_OF_CLAUSE:
        raise UsageError(f"it has {len(trials)} trials; permitted: 1 to {MAX_TRIALS_OF_CLAUSE}", where=where)
    names = [trial.name for trial in trials]
    for trial_name in names:
        if names.count(trial_name) > 1:
            raise UsageError(f"two trials are called {trial_name!r}", where=where, hint="give each a name of its own")
    n, required = _parse_repetitions_and_required_passes(document["repetitions"], where)
    _check_choices(document, where)
    return Clause(
        name=name,
        title=str(document["title"]),
        source=str(document["source"]),
        reading=" ".join(str(document.get("reading", "")).split()),
        n_repetitions=n,
        n_required=required,
        grade=document.get("grade", "nominal"),
        policy=document.get("policy", "none"),
        numbers=numbers,
        tolerances=tolerances,
        trials=tuple(trials),
        left_out={str(trial): str(reason) for trial, reason in left_out.items()},
    )


def _check_texts_are_printable(value: Any, path: str, where: str) -> None:
    """Refuse a text that would break a line, a table or an XML file; the lines of `reading` are joined."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            place = f"{path}.{key}" if path else str(key)
            _check_texts_are_printable(str(key), repr(place), where)
            _check_texts_are_printable(entry, place, where)
    elif isinstance(value, list):
        for entry in value:
            _check_texts_are_printable(entry, path, where)
    elif isinstance(value, str) and not (" ".join(value.split()) if path == "reading" else value).isprintable():
        raise UsageError(f"{path} is {value!r}; permitted: printable characters", where=where)


def _check_choices(document: Mapping[str, Any], where: str) -> None:
    """Refuse a grade or a policy that does not exist."""
    from cwcli.conformance.grades import SCENARIO_OVERRIDES_BY_GRADE
    from cwcli.conformance.policies import PEDALS_BY_POLICY

    for key, known in (("grade", SCENARIO_OVERRIDES_BY_GRADE), ("policy", PEDALS_BY_POLICY)):
        if key in document and not _is_one_of(document[key], known):
            raise UsageError(
                f"{key} is {document[key]!r}",
                where=where,
                hint=hint_at_closest_or_all_known_names(str(document[key]), known),
            )


def _is_one_of(value: object, known: Container[str]) -> bool:
    """Whether a value of the file is a text, and one of those known; a list is not even comparable with them."""
    return isinstance(value, str) and value in known


def _check_tolerances(tolerances: Mapping[str, PublishedNumber], where: str) -> None:
    """Refuse a tolerance that nothing is checked against, that is no single number, or of another unit or size."""
    for name, number in tolerances.items():
        if name not in LARGEST_TOLERANCE_AND_UNIT:
            hint = hint_at_closest_or_all_known_names(name, LARGEST_TOLERANCE_AND_UNIT)
            raise UsageError(f"tolerances.{name} is unknown", where=where, hint=hint)
        largest, unit = LARGEST_TOLERANCE_AND_UNIT[name]
        same_dimension = UNITS_BY_SI_UNIT[unit]
        if number.unit not in same_dimension:
            hint = f"one of: {', '.join(same_dimension)}"
            raise UsageError(f"tolerances.{name}.unit is {number.unit!r}", where=where, hint=hint)
        if len(number.values) != 1 or number.values_in_si_units[0] > largest:
            raise UsageError(
                f"tolerances.{name}.value is {number.text}; permitted: one number, at most {largest:g} {unit}",
                where=where,
            )


def _parse_repetitions_and_required_passes(table: Any, where: str) -> tuple[int, int]:
    """The number of repetitions, and how many must pass."""
    _check_keys(table, {"n", "required", "source", "basis"}, {"n", "required"}, "repetitions", where)
    n, required = table["n"], table["required"]
    if not (type(n) is int and type(required) is int and 1 <= required <= n <= 1000):
        raise UsageError(
            f"repetitions are n = {n!r} and required = {required!r}; permitted: 1 <= required <= n <= 1000",
            where=where,
        )
    return n, required


def _table_or_empty(document: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    """A table of the document, empty where it is missing."""
    table = document.get(key, {})
    if not isinstance(table, Mapping):
        raise UsageError(f"{key} is {table!r}; permitted: a table", where=where)
    return table


def _check_keys(table: Any, known: set[str], required: set[str], place: str, where: str) -> None:
    """Refuse what is no table, an unknown key, and a missing one."""
    if not isinstance(table, Mapping):
        raise UsageError(f"{place or 'the file'} is {table!r}; permitted: a table", where=where)
    prefix = f"{place}." if place else ""
    for key in table:
        if key not in known:
            raise UsageError(
                f"{prefix}{key} is unknown",
                where=where,
                hint=hint_at_closest_or_all_known_names(str(key), sorted(known)),
            )
    for key in sorted(required - set(table)):
        raise UsageError(f"{prefix}{key} is missing", where=where)


def _parse_number(name: str, table: Any, where: str, place: str = "numbers") -> PublishedNumber:
    """Check one number: finite, of a known unit, physically possible, and with a source."""
    path = f"{place}.{name}"
    _check_keys(table, NUMBER_KEYS, {"value", "unit", "source", "basis"}, path, where)
    if not _is_one_of(table["unit"], SI_PER_UNIT):
        raise UsageError(f"{path}.unit is {table['unit']!r}", where=where, hint=f"one of: {', '.join(SI_PER_UNIT)}")
    if not _is_one_of(table["basis"], TEXT_BY_BASIS_OF_CLAUSE_NUMBER):
        raise UsageError(
            f"{path}.basis is {table['basis']!r}",
            where=where,
            hint=f"one of: {', '.join(TEXT_BY_BASIS_OF_CLAUSE_NUMBER)}",
        )
    if not _is_one_of(table.get("ttc", ""), MEANING_BY_TTC_DEFINITION):
        raise UsageError(
            f"{path}.ttc is {table['ttc']!r}", where=where, hint=f"one of: {', '.join(MEANING_BY_TTC_DEFINITION)}"
        )
    if not isinstance(table["source"], str) or not table["source"]:
        raise UsageError(f"{path}.source is empty", where=where, hint="name the publication")
    raw = (
        table["value"]
        if isinstance(table["value"], Sequence) and not isinstance(table["value"], str)
        else [table["value"]]
    )
    largest = LARGEST_NUMBER_BY_UNIT[table["unit"]]
    is_positive = place == "tolerances" or bool(table.get("ttc"))
    lowest = 0.0 if is_positive or table["unit"] == "s" else -largest
    for value in raw:
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not is_number or not lowest <= value <= largest or (is_positive and value == 0.0):
            least = f"more than 0, at most {largest:g}" if is_positive else f"{lowest:g} to {largest:g}"
            raise UsageError(f"{path}.value is {value!r}; permitted: {least} {table['unit']}".rstrip(), where=where)
    if not raw:
        raise UsageError(f"{path}.value is empty", where=where)
    return PublishedNumber(
        name, tuple(map(float, raw)), table["unit"], table["source"], str(table.get("page", "")), table["basis"],
        table.get("ttc", ""),
    )  # fmt: skip


def _parse_trials(table: Any, numbers: Mapping[str, PublishedNumber], where: str) -> list[Trial]:
    """The trials of one table: one, or one for each entry of its lists of numbers."""
    from cwcli.conformance.scenes import SCENES

    _check_keys(table, TRIAL_KEYS, {"name", "scene", "judge"}, "trials", where)
    title = str(table["name"])
    if not _is_one_of(table["scene"], SCENES):
        hint = hint_at_closest_or_all_known_names(str(table["scene"]), SCENES)
        raise UsageError(f"{title}: there is no scene {table['scene']!r}", where=where, hint=hint)
    demands: Sequence[str] | None = getattr(
        require_judge_module(str(table["judge"]), where), "NUMBERS_THAT_JUDGE_NEEDS", None
    )
    for key in _table_or_empty(table, "demands", where):
        if demands is not None and key not in demands:
            hint = hint_at_closest_or_all_known_names(str(key), demands)
            raise UsageError(f"{title}: demands.{key} is unknown", where=where, hint=hint)
    used: dict[tuple[str, str], PublishedNumber] = {}
    for group in ("given", "demands"):
        for key, number in _table_or_empty(table, group, where).items():
            if not _is_one_of(number, numbers):
                raise UsageError(
                    f"{title}: {group}.{key} names the number {number!r}, which is not defined",
                    where=where,
                    hint=hint_at_closest_or_all_known_names(str(number), numbers),
                )
            used[group, key] = numbers[number]
            if key in TRIAL_INPUT_NAMES_THAT_MUST_BE_POSITIVE and min(numbers[number].values) <= 0.0:
                value = numbers[number].text
                raise UsageError(f"numbers.{number}.value is {value}; permitted: more than 0", where=where)
            _check_unit(f"{title}: {group}.{key}", key, numbers[number], where)
    SCENES[table["scene"]].check_keys([key for group, key in used if group == "given"], title, where)
    lists = list(dict.fromkeys(number.name for number in used.values() if len(number.values) > 1))
    if table.get("combine", "one by one") == "all":
        rows = list(itertools.product(*(range(len(numbers[name].values)) for name in lists)))
    else:
        lengths = {len(numbers[name].values) for name in lists}
        if len(lengths) > 1:
            raise UsageError(f"{title}: its lists of numbers differ in length", where=where, hint='or combine = "all"')
        rows = [(k,) * len(lists) for k in range(lengths.pop() if lengths else 1)]
    trials = []
    for row in rows:
        index = dict(zip(lists, row, strict=True))
        values = {place: number.values_in_si_units[index.get(number.name, 0)] for place, number in used.items()}
        shown = {name: f"{numbers[name].values[k]:g} {numbers[name].unit}".rstrip() for name, k in index.items()}
        labels = [
            text for name, text in shown.items() if any(n.name == name for (g, _), n in used.items() if g == "given")
        ]
        trials.append(
            Trial(
                name=f"{title}, {' / '.join(labels)}" if labels else title,
                scene=table["scene"],
                judge=table["judge"],
                given={key: value for (group, key), value in values.items() if group == "given"},
                demands={key: value for (group, key), value in values.items() if group == "demands"},
                rule=table.get("rule", ""),
                demands_text=_describe_demands(used, index),
            )
        )
    return trials


def _check_unit(path: str, key: str, number: PublishedNumber, where: str) -> None:
    """Refuse a number of another dimension than its name says."""
    words = str(key).split("_")
    unit = next((SI_UNIT_BY_WORD[word] for word in (words[-1], words[0]) if word in SI_UNIT_BY_WORD), None)
    if unit is not None and number.unit not in UNITS_BY_SI_UNIT[unit]:
        hint = f"one of: {', '.join(UNITS_BY_SI_UNIT[unit])}"
        raise UsageError(f"{path} has the unit {number.unit!r}", where=where, hint=hint)


def _describe_demands(used: Mapping[tuple[str, str], PublishedNumber], index: Mapping[str, int]) -> str:
    """The demands of a trial in words and in the file's units; what has no unit is a switch and is named alone.

    What a trial demands by choice of cwcli is marked, since nobody fails the standard by that number.
    """
    words = []
    for (place, key), number in used.items():
        if place == "demands":
            value = f"{number.values[index.get(number.name, 0)]:g} {number.unit}" if number.unit else ""
            chosen = f" ({CHOICE_TEXT})" if value and number.basis == "own" else ""
            words.append(f"{key.replace('_', ' ').replace('ttc', 'TTC')} {value}{chosen}".rstrip())
    return ", ".join(words)


def require_judge_module(judge: str, where: str) -> Any:
    """Return the module of a judge.

    Raises:
        UsageError: There is none.
    """
    module = f"cwcli.conformance.judges.{judge.replace('-', '_')}"
    if not all(word.isalnum() for word in judge.split("-")) or find_spec(module) is None:
        folder = files("cwcli.conformance") / "judges"
        names = [entry.name.removesuffix(".py").replace("_", "-") for entry in folder.iterdir()]
        known = sorted(name for name in names if name.isascii() and not name.startswith("-"))
        raise UsageError(
            f"there is no judge {judge!r}", where=where, hint=hint_at_closest_or_all_known_names(judge, known)
        )
    return import_module(module)
