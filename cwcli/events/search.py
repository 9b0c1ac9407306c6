"""Finds events and expressions in one log."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence

import numpy as np

from cwcli.errors import MissingSignalError
from cwcli.evaluation.system_topics import OtherSystemTopics
from cwcli.events import EVENTS
from cwcli.events.base import Moment, severity_as_ratio_to_threshold
from cwcli.events.evidence import EventEvidence
from cwcli.events.quantities import (
    EGO_PREFIX,
    OTHER_PREFIX,
    check_names_and_units,
    last_value_before_grid_times,
    measure_by_expression_name,
    needs_other_vehicle,
    read_field_times_ns_and_values,
    trailing_window_values,
)
from cwcli.events.syntax import (
    ALL_EVENTS_NAME,
    EventName,
    Lasting,
    Near,
    Node,
    Series,
    event_names,
    parse_expression,
)
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.metrics.condition_parser import AndOr, Comparison, Not, Number
from cwcli.metrics.table import ColumnDoc, Table, TableColumn, unit_of_column
from cwcli.pipeline.records import read_run_records
from cwcli.signals.columns import BoolArray, FloatArray, Int64Array
from cwcli.signals.field_condition import COMPARISONS_BY_SIGN
from cwcli.signals.row_order import first_and_last_rows_of_runs
from cwcli.signals.units import NS_PER_S
from cwcli.signals.vehicle_state import STATE_NAMES
from cwcli.text import format_number

EVENT_NAME_OF_EXPRESSION = "expression"
"""The name of the event in the results of an expression."""
EVENT_NAMES_FOUND_BY_WARNING = ("warning-true", "warning-late", "warning-false", "warning-undecided")
"""Events that `warning` finds too."""
EVENT_ID_HEX_DIGITS = 12
"""Length of an id, hexadecimal digits: two of a million events are equal with a probability of 0.2 %."""
MAX_PAUSE_IN_EVENT_S = 0.25
"""Moments of an expression with a shorter pause are one, s. Chosen by hand: noise at a threshold."""


@dataclass(frozen=True)
class FoundEvent:
    """An event that was found in a log.

    Attributes:
        id: The same for the same event in every run over the same log, and in a clip of it.
        event: Name of the event, or `EVENT_NAME_OF_EXPRESSION`.
        start_s: From the log's start, s.
        value_name: What the value is, with its unit.
    """

    id: str
    log: str
    event: str
    moment: Moment
    start_s: float
    value_name: str

    @property
    def key(self) -> tuple[str, str]:
        """Log and id: the same drive can be searched in several runs."""
        return self.log, self.id

    @property
    def duration_s(self) -> float:
        """How long it lasted, s."""
        return (self.moment.end_ns - self.moment.start_ns) / NS_PER_S

    @property
    def rank(self) -> tuple[float | int | str, ...]:
        """The key that sorts events: the most severe first; of equal ones by kind (near misses first), then value."""
        kinds = list(EVENTS)
        value = self.moment.value if self.value_name.startswith("least_") else -self.moment.value
        kind = kinds.index(self.event) if self.event in kinds else len(kinds)
        known = value if np.isfinite(value) else np.inf
        return -self.moment.severity, kind, self.event, known, self.log, self.moment.start_ns, self.id

    @property
    def words(self) -> str:
        """What happened, with the value and its unit, for people."""
        return _describe_moment(self.moment, self.value_name)


@dataclass(frozen=True)
class LogSearch:
    """What was found in one log.

    Attributes:
        missing: Event -> why the log can't tell, for events of `all`.
    """

    found: tuple[FoundEvent, ...]
    missing: dict[str, str]


@dataclass(frozen=True)
class Query:
    """What is looked for.

    Attributes:
        events: The events, if it is nothing but events; None for another expression.
        is_all: It is the word for all events: those that a log can't tell are left out and noted.
    """

    text: str
    node: Node
    events: tuple[str, ...] | None
    is_all: bool = False


def parse_query(text: str) -> Query:
    """Parse what is looked for.

    Raises:
        UsageError: It is no expression, a name is unknown, or a unit does not fit.
    """
    names = tuple(EVENTS)
    if text.strip() == ALL_EVENTS_NAME:
        every = tuple(name for name in names if name not in EVENT_NAMES_FOUND_BY_WARNING)
        return Query(text, AndOr(tuple(map(EventName, every)), is_and=False), every, is_all=True)
    node = parse_expression(text, names)
    for comparison in _iter_comparisons(node):
        check_names_and_units(comparison)
    return Query(text, node, event_names(node))


def find_events_in_log(
    log: Log, query: Query, other_system: OtherSystemTopics | None = None, name: str = ""
) -> LogSearch:
    """Find what is looked for in one log, on disk or in memory.

    Raises:
        MissingSignalError: The log lacks what the expression needs.
        UsageError: It needs the topics of another system, and none is named.
        InputError: The log is damaged.
    """
    evidence = EventEvidence(log, other_system)
    key, name = _drive_key_or_empty(log), name or log.name
    found: list[FoundEvent] = []
    missing: dict[str, str] = {}
    if query.events is None:
        found += [
            _event_from_moment(f"{key}\0{query.text}", name, log, EVENT_NAME_OF_EXPRESSION, each, value_name)
            for each, value_name in _iter_moments_and_value_names_where_true(evidence, query)
        ]
    for event in query.events or ():
        if query.is_all and event == "disagreement" and (other_system is None or not other_system.warning):
            continue
        kind = EVENTS[event]
        try:
            found += [_event_from_moment(key, name, log, event, each, kind.value_name) for each in kind.find(evidence)]
        except MissingSignalError as error:
            if not query.is_all:
                raise
            missing[event] = error.what
    return LogSearch(tuple(sorted(found, key=lambda each: (each.moment.start_ns, each.event, each.id))), missing)


def table_of_events(events: Sequence[FoundEvent]) -> Table:
    """Return the events as a table, one row each, in the given order."""
    moments = [each.moment for each in events]
    columns: dict[str, TableColumn] = {
        "id": [each.id for each in events],
        "log": [each.log for each in events],
        "event": [each.event for each in events],
        "start_ns": np.array([each.start_ns for each in moments], np.int64),
        "end_ns": np.array([each.end_ns for each in moments], np.int64),
        "start_s": np.array([each.start_s for each in events], float),
        "duration_s": np.array([each.duration_s for each in events], float),
        "actors": [" ".join(each.actors) for each in moments],
        "value": np.array([each.value for each in moments], float),
        "value_name": [each.value_name for each in events],
        "severity": np.array([each.severity for each in moments], float),
        "detail": [each.detail for each in moments],
        "words": [each.words for each in events],
    }
    docs = {
        "id": ColumnDoc("the same for the same event in every run"),
        "start_s": ColumnDoc("from the log's start"),
        "value": ColumnDoc("what value_name says"),
        "severity": ColumnDoc("how many times the value is beyond the event's threshold, at most 10"),
    }
    return Table("events", columns, docs)


def _describe_value(name: str, value: float) -> str:
    """Return a value with its name and unit in words; "" where it is not known."""
    unit = unit_of_column(name)
    name = name.removesuffix(name.rpartition("_")[2]) if unit else name
    return f"{name.replace('_', ' ').strip()} {format_number(value)} {unit}".strip() if np.isfinite(value) else ""


def _describe_moment(moment: Moment, value_name: str) -> str:
    """Return what happened in a moment, with the value and its unit, for people."""
    return moment.words or ", ".join(filter(None, (_describe_value(value_name, moment.value), moment.detail)))


def _event_from_moment(key: str, name: str, log: Log, event: str, moment: Moment, value_name: str) -> FoundEvent:
    """Return a moment as an event of a log, with its id."""
    text = "\0".join((key, event, str(moment.start_ns), *moment.actors, moment.detail))
    digest = hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:EVENT_ID_HEX_DIGITS]
    return FoundEvent(digest, name, event, moment, (moment.start_ns - log.start_ns) / NS_PER_S, value_name)


def _drive_key_or_empty(log: Log) -> str:
    """Return what identifies a drive: the hash of the recorded log in the records of the runs; "" without one.

    A clip carries the same records, so that its events have the ids that they have in the whole log.
    """
    hashes = sorted({record["input_sha256"] for record in read_run_records(log).values() if "input_sha256" in record})
    return hashes[0] if hashes else ""


def _iter_comparisons(node: Node) -> Iterator[Comparison]:
    """Yield the comparisons in an expression."""
    if isinstance(node, Comparison):
        yield node
    elif isinstance(node, AndOr):
        for part in node.parts:
            yield from _iter_comparisons(part)
    elif isinstance(node, Near):
        yield from _iter_comparisons(node.inner)
        yield from _iter_comparisons(node.anchor)
    elif isinstance(node, Lasting | Not):
        yield from _iter_comparisons(node.inner)


def _name_of_first_quantity(comparison: Comparison) -> str:
    """Return the name of the first quantity in a comparison, with its function."""
    quantity = next(each for each in comparison.operands if isinstance(each, Series))
    return f"{quantity.function} {quantity.name}".strip()


def _iter_event_names(node: Node) -> Iterator[str]:
    """Yield the events in an expression."""
    if isinstance(node, EventName):
        yield node.name
    elif isinstance(node, AndOr):
        for part in node.parts:
            yield from _iter_event_names(part)
    elif isinstance(node, Near):
        yield from _iter_event_names(node.inner)
        yield from _iter_event_names(node.anchor)
    elif isinstance(node, Lasting | Not):
        yield from _iter_event_names(node.inner)


def _reach_of_anchor_ns(node: Near) -> tuple[int, int]:
    """Return how long before and after a moment the other condition may hold [ns]."""
    within_ns = round(node.within_s * NS_PER_S)
    return within_ns * (node.relation != "before"), within_ns * (node.relation != "after")


def _iter_moments_and_value_names_where_true(evidence: EventEvidence, query: Query) -> Iterator[tuple[Moment, str]]:
    """Yield the moments in which an expression holds, for each other vehicle if it is about one.

    Each comes with the name of its value.
    """
    for comparison in _iter_comparisons(query.node):
        check_names_and_units(comparison, evidence.log)
    operands = [operand for each in _iter_comparisons(query.node) for operand in each.operands]
    moments = {name: list(EVENTS[name].find(evidence)) for name in set(_iter_event_names(query.node))}
    about_pairs = any(map(needs_other_vehicle, operands))
    is_of_fields = operands and all(isinstance(each, Number) or each.name.startswith("/") for each in operands)
    if is_of_fields and not moments:
        times = [
            read_field_times_ns_and_values(evidence, each.name)[0] for each in operands if isinstance(each, Series)
        ]
        evaluation = _Evaluation(evidence, moments, np.unique(np.concatenate(times)), None)
        yield from evaluation.iter_moments_and_value_names(query.node, ("ego",))
        return
    ids = [other_id for other_id, _ in evidence.iter_pairs()] if about_pairs else [None]
    for other_id in ids:
        actors = (evidence.ego_id,) if other_id is None else (evidence.ego_id, other_id)
        evaluation = _Evaluation(evidence, moments, evidence.stamp_ns, other_id)
        yield from evaluation.iter_moments_and_value_names(query.node, actors)


class _Evaluation:
    """Evaluates an expression on a grid of times, with one other vehicle or none."""

    def __init__(
        self, evidence: EventEvidence, moments: dict[str, list[Moment]], grid_ns: Int64Array, other_id: str | None
    ) -> None:
        self._evidence, self._moments, self._grid_ns, self._other_id = evidence, moments, grid_ns, other_id
        self._masks: dict[Node, BoolArray] = {}

    def iter_moments_and_value_names(self, node: Node, actors: tuple[str, ...]) -> Iterator[tuple[Moment, str]]:
        """Yield the moments in which the expression holds, and the name of the value of each.

        Vehicles and words are those of the events that make it hold. Value and severity are those of the first of
        these events; without one, the extreme of the first comparison that makes it hold.
        """
        spans: list[tuple[int, int]] = []
        for first, last in first_and_last_rows_of_runs(self._mask_where_condition_holds(node)):
            if spans and self._grid_ns[first] - self._grid_ns[spans[-1][1]] < MAX_PAUSE_IN_EVENT_S * NS_PER_S:
                spans[-1] = spans[-1][0], last
            else:
                spans.append((first, last))
        for first, last in spans:
            rows = np.zeros(len(self._grid_ns), np.bool_)
            rows[first : last + 1] = True
            value, severity, value_name, words = np.nan, 1.0, "", [""]
            events: dict[str, Moment] = {}
            for part, own_rows in self._iter_parts_that_hold(node, rows):
                if isinstance(part, Comparison):
                    if not value_name:
                        value, severity = self._extreme_and_severity(part, own_rows)
                        value_name = _name_of_first_quantity(part)
                        words = [_describe_value(value_name, value)]
                    continue
                for each in self._moments_with_other(part.name):
                    happens = own_rows[self._rows_of_moment(each)].any()
                    if happens and (part.name not in events or each.severity > events[part.name].severity):
                        events[part.name] = each
            for name, each in events.items():
                words.append(f"{name}: {_describe_moment(each, EVENTS[name].value_name)}")
            if events:
                name, worst = next(iter(events.items()))
                value, severity, value_name = worst.value, worst.severity, EVENTS[name].value_name
            others = (actor for each in events.values() for actor in each.actors if actor != "ego")
            moment = Moment(
                int(self._grid_ns[first]),
                int(self._grid_ns[last]),
                tuple(dict.fromkeys((*actors, *others))),
                value,
                severity,
                words="; ".join(filter(None, words)),
            )
            yield moment, value_name

    def _iter_parts_that_hold(self, node: Node, rows: BoolArray) -> Iterator[tuple[Comparison | EventName, BoolArray]]:
        """Yield the events and comparisons that make an expression hold in some rows, and the rows of each, (n,).

        A comparison behind `not` is that of all rows in which the `not` holds; an event behind `not` is none.
        """
        rows = rows & self._mask_where_condition_holds(node)
        if not rows.any():
            return
        if isinstance(node, Comparison | EventName):
            yield node, rows
        elif isinstance(node, Not):
            yield from ((each, rows) for each in _iter_comparisons(node.inner))
        elif isinstance(node, AndOr):
            for part in node.parts:
                yield from self._iter_parts_that_hold(part, rows)
        else:
            yield from self._iter_parts_that_hold(node.inner, rows)
            if isinstance(node, Near):
                back_ns, ahead_ns = _reach_of_anchor_ns(node)
                in_reach = self._mask_of_rows_near(self._grid_ns[rows], ahead_ns, back_ns)
                yield from self._iter_parts_that_hold(node.anchor, in_reach)

    def _moments_with_other(self, name: str) -> Iterator[Moment]:
        """Yield the moments of an event; if the expression is about another vehicle, those with no other than it."""
        for each in self._moments[name]:
            others = [actor for actor in each.actors[1:] if actor in self._evidence.tracks.others]
            if self._other_id is None or not others or self._other_id in others:
                yield each

    def _extreme_and_severity(self, comparison: Comparison, rows: BoolArray) -> tuple[float, float]:
        """Return the value of the first quantity that is farthest beyond its constant, and by how many times."""
        at = next(k for k, operand in enumerate(comparison.operands) if isinstance(operand, Series))
        values = self._operand_values_on_grid(comparison.operands[at])[rows]
        known = values[np.isfinite(values)]
        if not len(known):
            return np.nan, 1.0
        sign = comparison.signs[min(at, len(comparison.signs) - 1)]
        is_low = sign.startswith("<") == (at == 0 or len(comparison.signs) > 1)
        value = float(known.min() if is_low else known.max())
        limit = next((each.value for each in comparison.operands if isinstance(each, Number)), np.nan)
        if not (np.isfinite(limit) and limit != 0.0 and value * limit >= 0.0):  # no ratio across zero
            return value, 1.0
        return value, severity_as_ratio_to_threshold(value, limit, "low" if is_low else "high")

    def _mask_where_condition_holds(self, node: Node) -> BoolArray:
        """Return where a condition holds, (n,)."""
        if node not in self._masks:
            self._masks[node] = self._evaluate_mask(node)
        return self._masks[node]

    def _evaluate_mask(self, node: Node) -> BoolArray:
        if isinstance(node, Comparison):
            return self._mask_where_comparison_holds(node)
        if isinstance(node, EventName):
            return self._mask_where_event_happens(node.name)
        if isinstance(node, Not):
            return ~self._mask_where_condition_holds(node.inner)
        if isinstance(node, AndOr):
            parts = [self._mask_where_condition_holds(part) for part in node.parts]
            return np.asarray((np.logical_and if node.is_and else np.logical_or).reduce(parts))
        if isinstance(node, Lasting):
            return self._mask_of_long_stretches(self._mask_where_condition_holds(node.inner), node.min_s)
        return self._mask_near_anchor(node)

    def _mask_where_comparison_holds(self, node: Comparison) -> BoolArray:
        holds = np.ones(len(self._grid_ns), np.bool_)
        for sign, left, right in zip(node.signs, node.operands, node.operands[1:], strict=False):
            one, other = self._operand_values_on_grid(left), self._operand_values_on_grid(right)
            holds &= np.isfinite(one) & np.isfinite(other) & COMPARISONS_BY_SIGN[sign](one, other)
        return holds

    def _mask_where_event_happens(self, name: str) -> BoolArray:
        """Return where an event happens, with the other vehicle if the expression is about one."""
        holds = np.zeros(len(self._grid_ns), np.bool_)
        for each in self._moments_with_other(name):
            holds[self._rows_of_moment(each)] = True
        return holds

    def _rows_of_moment(self, moment: Moment) -> slice:
        first = np.searchsorted(self._grid_ns, moment.start_ns, side="left")
        return slice(int(first), int(np.searchsorted(self._grid_ns, moment.end_ns, side="right")))

    def _mask_of_long_stretches(self, holds: BoolArray, min_s: float) -> BoolArray:
        """Return the stretches that last long enough."""
        out = np.zeros(len(holds), np.bool_)
        for first, last in first_and_last_rows_of_runs(holds):
            out[first : last + 1] = self._grid_ns[last] - self._grid_ns[first] >= min_s * NS_PER_S
        return out

    def _mask_near_anchor(self, node: Near) -> BoolArray:
        """Return where a condition holds and another one holds within a time before, after or around it."""
        anchor_ns = self._grid_ns[self._mask_where_condition_holds(node.anchor)]
        is_near = self._mask_of_rows_near(anchor_ns, *_reach_of_anchor_ns(node))
        return self._mask_where_condition_holds(node.inner) & is_near

    def _mask_of_rows_near(self, times_ns: Int64Array, back_ns: int, ahead_ns: int) -> BoolArray:
        """Return the rows for which some of the times lie at most so long before or behind, (n,)."""
        first = np.searchsorted(times_ns, self._grid_ns - back_ns, side="left")
        last = np.searchsorted(times_ns, self._grid_ns + ahead_ns, side="right")
        return np.asarray(last > first)

    def _operand_values_on_grid(self, operand: Number | Series) -> FloatArray:
        """Return the values of an operand on the grid, (n,); NaN where it is not known."""
        if isinstance(operand, Number):
            return np.full(len(self._grid_ns), operand.value)
        values = self._quantity_on_grid(operand.name)
        if operand.function:
            return trailing_window_values(values, self._grid_ns, operand.function, operand.window_s)
        return values

    def _quantity_on_grid(self, name: str) -> FloatArray:
        """Return the values of a quantity on the grid."""
        evidence = self._evidence
        if name.startswith("/"):
            return last_value_before_grid_times(*read_field_times_ns_and_values(evidence, name), self._grid_ns)
        if name.startswith(EGO_PREFIX):
            return np.asarray(evidence.ego_state[:, STATE_NAMES.index(name.removeprefix(EGO_PREFIX))])
        assert self._other_id is not None  # a quantity of a pair is evaluated for each other vehicle
        pair = evidence.pair_with_ego(self._other_id)
        if name.startswith(OTHER_PREFIX):
            k = STATE_NAMES.index(name.removeprefix(OTHER_PREFIX))
            if k < 4:
                return np.asarray(pair.other_states[:, k])
            column = {"accel_mps2": 0, "yaw_rate_radps": 1, "jerk_mps3": 2}.get(STATE_NAMES[k])
            return np.full(len(self._grid_ns), np.nan) if column is None else pair.other_derivatives[:, column]
        return np.asarray(pair.evaluate_measure(MEASURES[measure_by_expression_name()[name]]))
