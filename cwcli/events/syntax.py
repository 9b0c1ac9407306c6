"""The grammar of what is looked for: that of the gates, over time. It is parsed into the nodes below and never run.

find       = and { "or" and }
and        = not { "and" not }
not        = "not" not | timed
timed      = condition { "for" time | "within" time ("after" | "before" | "of") condition }
condition  = "(" find ")" | event | comparison
comparison = operand compare operand [ compare operand ]
operand    = number [ unit ] | name | ("min" | "max" | "mean") "(" name ")" "over" time
compare    = "<" | "<=" | ">" | ">=" | "==" | "!="
event      = a name in `cwcli.events.EVENTS`
name       = ego.speed_mps, other.speed_mps, a measure (ttc_s), or a field of a topic (/status:speed)
"""

from __future__ import annotations

import math
import re

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.condition_parser import (
    COMPARISON_OPERATOR_OR_PARENTHESIS_PATTERN,
    LOGICAL_WORDS,
    NUMBER_PATTERN,
    AndOr,
    Comparison,
    ConditionParser,
    Not,
    Number,
)

WINDOW_FUNCTIONS = ("min", "max", "mean")
"""Functions of a name's values in a time window that ends at each moment."""
WITHIN_RELATIONS = ("after", "before", "of")
"""Words behind `within TIME`: where the other condition holds relative to the moment."""
MAX_TIME_WINDOW_S = 3600.0
"""Greatest length of a time window, s; chosen by hand: longer ones are the whole log."""
UNIT_AND_FACTOR_BY_SPELLING = {
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "min": ("s", 60.0),
    "m": ("m", 1.0),
    "km": ("m", 1e3),
    "cm": ("m", 1e-2),
    "m/s": ("m/s", 1.0),
    "mps": ("m/s", 1.0),
    "km/h": ("m/s", 1.0 / 3.6),
    "kmh": ("m/s", 1.0 / 3.6),
    "mph": ("m/s", 0.44704),
    "m/s^2": ("m/s^2", 1.0),
    "m/s2": ("m/s^2", 1.0),
    "mps2": ("m/s^2", 1.0),
    "g": ("m/s^2", 9.80665),
    "m/s^3": ("m/s^3", 1.0),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180.0),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180.0),
    "%": ("", 1e-2),
}
"""Unit behind a number -> the unit of the quantities that it fits, and the factor to it (SI; NIST SP 811)."""
ALL_EVENTS_NAME = "all"
"""The word for every named event but those that are parts of another one."""
WORDS_ALLOWED_AFTER_NUMBER_WITHOUT_UNIT = LOGICAL_WORDS | {"for", "within", "over"}
"""Words that may follow a number without a unit."""
EXPRESSION_EXAMPLE = "for example 'min(ttc_s) over 3 s < 1.5 and ego.speed_mps > 8', or 'cut-in'"
"""Valid expressions, which the hints of syntax errors show."""

_TOKEN_PATTERN = re.compile(
    rf"\s*(?:{NUMBER_PATTERN})"
    r"|(?P<field>/[^\s:()<>=!]+:[A-Za-z_][\w.\[\]]*)"
    rf"|(?P<name>[A-Za-z][A-Za-z0-9_.-]*)|{COMPARISON_OPERATOR_OR_PARENTHESIS_PATTERN})"
)
"""Pattern of one token after any white space: a number, a field of a topic, a name or a sign."""
_UNIT_PATTERN = re.compile(
    r"\s*("
    + "|".join(re.escape(unit) for unit in sorted(UNIT_AND_FACTOR_BY_SPELLING, key=len, reverse=True))
    + r")(?![\w/^(])"
)
"""Pattern of a unit behind a number."""


@dataclass(frozen=True)
class Series:
    """A quantity over time: a state of the ego or the other, a measure, or a field of a topic.

    Attributes:
        function: One of `WINDOW_FUNCTIONS`, or "".
        window_s: Length of the window of the function, s.
    """

    name: str
    function: str = ""
    window_s: float = 0.0


@dataclass(frozen=True)
class EventName:
    """A named event."""

    name: str


@dataclass(frozen=True)
class Lasting:
    """A condition that holds for at least a time [s]."""

    inner: Node
    min_s: float


@dataclass(frozen=True)
class Near:
    """A condition that holds within a time [s] `after`, `before` or around (`of`) another one."""

    inner: Node
    within_s: float
    relation: str
    anchor: Node


Node = Comparison | EventName | Lasting | Near | Not | AndOr


def parse_expression(text: str, events: tuple[str, ...]) -> Node:
    """Parse an expression.

    Raises:
        UsageError: It is none; the message says where and what was expected.
    """
    node: Node = _Parser(text, events).parse_to_end("`and`, `or`, `for`, `within` or the end")
    return node


def event_names(node: Node) -> tuple[str, ...] | None:
    """Return the events of an expression that is nothing but events joined by `or`; None for another one."""
    if isinstance(node, EventName):
        return (node.name,)
    if isinstance(node, AndOr) and not node.is_and and all(isinstance(part, EventName) for part in node.parts):
        return tuple(dict.fromkeys(part.name for part in node.parts if isinstance(part, EventName)))
    return None


class _Parser(ConditionParser):
    """The parser of the grammar above."""

    what, example, token = "an expression", EXPRESSION_EXAMPLE, _TOKEN_PATTERN

    def __init__(self, text: str, events: tuple[str, ...]) -> None:
        super().__init__(text)
        self._events = events

    def parse_term(self) -> Node:
        """Parse `timed` of the grammar."""
        node = self._parse_plain_condition()
        while True:
            if self.take_if_next("name", "for"):
                node = Lasting(node, self._parse_time())
            elif self.take_if_next("name", "within"):
                within_s = self._parse_time()
                kind, relation, _ = self.next_token_without_taking_it()
                if kind != "name" or relation not in WITHIN_RELATIONS:
                    raise self.error_at_token("`after`, `before` or `of`")
                self.next_token()
                node = Near(node, within_s, relation, self._parse_plain_condition())
            else:
                return node

    def _parse_plain_condition(self) -> Node:
        if self.next_token_without_taking_it()[1] == "(":
            node: Node = self.parse_in_parentheses()
            return node
        kind, text, _ = self.next_token_without_taking_it()
        if kind == "name" and text in self._events:
            self.next_token()
            return EventName(text)
        return self.parse_comparison()

    def error_without_sign(self, operand: Number | Series) -> UsageError:
        """Return the error about an operand that is compared with nothing: it may be a misspelt event."""
        if isinstance(operand, Number) or operand.function or operand.name.startswith("/"):
            return super().error_without_sign(operand)
        if operand.name == ALL_EVENTS_NAME:
            return UsageError(f"`{ALL_EVENTS_NAME}` stands alone, for every event", hint=EXPRESSION_EXAMPLE)
        if self.next_token_without_taking_it()[0] != "other":
            return UsageError(
                f"there is no event {operand.name}",
                hint=hint_at_closest_or_all_known_names(operand.name, self._events, "events"),
            )
        return super().error_without_sign(operand)

    def parse_operand(self) -> Number | Series:
        """Parse `operand` of the grammar."""
        kind, text, _ = self.next_token_without_taking_it()
        if kind == "number":
            number = self._parse_number()
            kind, text, _ = self.next_token_without_taking_it()
            if number.unit is None and kind == "name" and text not in WORDS_ALLOWED_AFTER_NUMBER_WITHOUT_UNIT:
                hint = hint_at_closest_or_all_known_names(text, UNIT_AND_FACTOR_BY_SPELLING, "units")
                raise UsageError(f"there is no unit {text}", hint=hint)
            return number
        if text == "/":
            raise self.error_at_token("a field of the topic, as in /topic:field")
        if kind not in ("name", "field") or text in {*LOGICAL_WORDS, "for", "within", "over"}:
            raise self.error_at_token("an event, a quantity or a number")
        self.next_token()
        if kind == "field" or self.next_token_without_taking_it()[1] != "(":
            return Series(text)
        if text not in WINDOW_FUNCTIONS:
            raise UsageError(
                f"there is no function {text}", hint=hint_at_closest_or_all_known_names(text, WINDOW_FUNCTIONS, "known")
            )
        self.require_sign("(")
        kind, name, _ = self.next_token_without_taking_it()
        if kind not in ("name", "field"):
            raise self.error_at_token("a quantity")
        self.next_token()
        self.require_sign(")")
        if not self.take_if_next("name", "over"):
            raise self.error_at_token(f"`over` and a time, as in {text}({name}) over 3 s")
        return Series(name, text, self._parse_time())

    def _parse_number(self) -> Number:
        """Parse a number with its unit, if there is one."""
        _, text, start = self.next_token()
        value = self.finite_number(text, start)
        found = _UNIT_PATTERN.match(self.text, self.at)
        if found is None:
            return Number(value)
        self.at = found.end()
        unit, factor = UNIT_AND_FACTOR_BY_SPELLING[found[1]]
        return Number(value * factor, unit)

    def _parse_time(self) -> float:
        """Parse a time window, s."""
        if self.next_token_without_taking_it()[0] != "number":
            raise self.error_at_token("a time such as 3 s")
        start = self.next_token_without_taking_it()[2]
        number = self._parse_number()
        if number.unit is None:
            raise self.error_at_token("a unit behind the time, such as s")
        if number.unit != "s":
            raise self.error_at_token("a time such as 3 s", start)
        if not 0.0 < number.value <= MAX_TIME_WINDOW_S:
            raise self.error_at_token(f"a time above 0 s and up to {MAX_TIME_WINDOW_S:g} s", start)
        return number.value
