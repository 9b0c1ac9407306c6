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

from cwcli.errors import UsageError, names_hint
from cwcli.lazy_dataclass import dataclass
from cwcli.metrics.gate_syntax import COMPARISONS, MAX_DEPTH, MAX_LENGTH

WINDOW_FUNCTIONS = ("min", "max", "mean")
"""Functions of a name's values in a time window that ends at each moment."""
RELATIONS = ("after", "before", "of")
"""Words behind `within TIME`: where the other condition holds relative to the moment."""
MAX_WINDOW_S = 3600.0
"""Greatest length of a time window, s; chosen by hand: longer ones are the whole log."""
UNITS = {
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
EXAMPLE = "for example 'min(ttc_s) over 3 s < 1.5 and ego.speed_mps > 8', or 'cut-in'"
"""Valid expressions, which the hints of syntax errors show."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<field>/[^\s:()<>=!]+:[A-Za-z_][\w.\[\]]*)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9_.-]*)"
    r"|(?P<sign><=|>=|==|!=|<|>|\(|\)))"
)
"""Pattern of one token after any white space: a number, a field of a topic, a name or a sign."""
_UNIT = re.compile(
    r"\s*(" + "|".join(re.escape(unit) for unit in sorted(UNITS, key=len, reverse=True)) + r")(?![\w/^(])"
)
"""Pattern of a unit behind a number."""


@dataclass(frozen=True)
class Number:
    """A constant.

    Attributes:
        value: In the SI unit, if a unit was given.
        unit: The SI unit; None where none was given.
    """

    value: float
    unit: str | None = None


@dataclass(frozen=True)
class Series:
    """A quantity over time: a state of the ego or the other, a measure, or a field of a topic.

    Attributes:
        name: As it was written.
        function: One of `WINDOW_FUNCTIONS`, or "".
        window_s: Length of the window of the function, s.
    """

    name: str
    function: str = ""
    window_s: float = 0.0


@dataclass(frozen=True)
class Comparison:
    """A comparison, `left sign right` or a chain of two; it has one operand more than signs."""

    operands: tuple[Number | Series, ...]
    signs: tuple[str, ...]


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


@dataclass(frozen=True)
class Not:
    """The negation of a condition."""

    inner: Node


@dataclass(frozen=True)
class AndOr:
    """A conjunction (`is_and`) or disjunction of conditions."""

    parts: tuple[Node, ...]
    is_and: bool


Node = Comparison | EventName | Lasting | Near | Not | AndOr


def parse_expression(text: str, events: tuple[str, ...]) -> Node:
    """Parse an expression.

    Args:
        text: The expression.
        events: The names of events.

    Raises:
        UsageError: It is none; the message says where and what was expected.
    """
    if len(text) > MAX_LENGTH:
        raise UsageError(f"an expression of {len(text)} characters is longer than {MAX_LENGTH}", hint=EXAMPLE)
    return _Parser(text, events).parse_whole()


def event_names(node: Node) -> tuple[str, ...] | None:
    """Return the events of an expression that is nothing but events joined by `or`; None for another one."""
    if isinstance(node, EventName):
        return (node.name,)
    if isinstance(node, AndOr) and not node.is_and and all(isinstance(part, EventName) for part in node.parts):
        return tuple(dict.fromkeys(part.name for part in node.parts if isinstance(part, EventName)))
    return None


class _Parser:
    """A recursive-descent parser."""

    def __init__(self, text: str, events: tuple[str, ...]) -> None:
        self._text, self._events = text, events
        self._at = 0
        self._depth = 0

    def parse_whole(self) -> Node:
        """Parse `find` up to the end of the text."""
        node = self._parse_or()
        if self._peek()[0] != "end":
            raise self._error("`and`, `or`, `for`, `within` or the end")
        return node

    def _parse_or(self) -> Node:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise UsageError(f"the expression has more than {MAX_DEPTH} parentheses inside each other")
        parts = [self._parse_and()]
        while self._take("name", "or"):
            parts.append(self._parse_and())
        self._depth -= 1
        return parts[0] if len(parts) == 1 else AndOr(tuple(parts), is_and=False)

    def _parse_and(self) -> Node:
        parts = [self._parse_not()]
        while self._take("name", "and"):
            parts.append(self._parse_not())
        return parts[0] if len(parts) == 1 else AndOr(tuple(parts), is_and=True)

    def _parse_not(self) -> Node:
        negations = 0
        while self._take("name", "not"):
            negations += 1
        node = self._parse_timed()
        return Not(node) if negations % 2 else node

    def _parse_timed(self) -> Node:
        node = self._parse_condition()
        while True:
            if self._take("name", "for"):
                node = Lasting(node, self._parse_time())
            elif self._take("name", "within"):
                within_s = self._parse_time()
                kind, relation, _ = self._peek()
                if kind != "name" or relation not in RELATIONS:
                    raise self._error("`after`, `before` or `of`")
                self._next()
                node = Near(node, within_s, relation, self._parse_condition())
            else:
                return node

    def _parse_condition(self) -> Node:
        if self._take("sign", "("):
            node = self._parse_or()
            self._require(")")
            return node
        kind, text, _ = self._peek()
        if kind == "name" and text in self._events:
            self._next()
            return EventName(text)
        return self._parse_comparison()

    def _parse_comparison(self) -> Comparison:
        kind, text, _ = self._peek()
        operands = [self._parse_operand()]
        signs: list[str] = []
        while self._peek()[1] in COMPARISONS and len(signs) < 2:
            signs.append(self._next()[1])
            operands.append(self._parse_operand())
        if not signs:
            if kind == "name" and isinstance(operands[0], Series) and not operands[0].function:
                raise UsageError(f"there is no event {text}", hint=names_hint(text, self._events, "events"))
            raise self._error(f"one of {' '.join(COMPARISONS)}")
        if all(isinstance(operand, Number) for operand in operands):
            raise UsageError(f"the expression compares numbers only: {self._text.strip()}", hint=EXAMPLE)
        return Comparison(tuple(operands), tuple(signs))

    def _parse_operand(self) -> Number | Series:
        kind, text, start = self._peek()
        if kind == "number":
            return self._parse_number()
        if kind not in ("name", "field") or text in {"and", "or", "not", "for", "within", "over"}:
            raise self._error("an event, a quantity or a number")
        self._next()
        if kind == "field" or self._peek()[1] != "(":
            return Series(text)
        if text not in WINDOW_FUNCTIONS:
            raise UsageError(f"there is no function {text}", hint=names_hint(text, WINDOW_FUNCTIONS, "known"))
        self._require("(")
        kind, name, start = self._peek()
        if kind not in ("name", "field"):
            raise self._error("a quantity")
        self._next()
        self._require(")")
        if not self._take("name", "over"):
            raise self._error(f"`over` and a time, as in {text}({name}) over 3 s")
        del start
        return Series(name, text, self._parse_time())

    def _parse_number(self) -> Number:
        """Parse a number with its unit, if there is one."""
        _, text, start = self._next()
        value = float(text)
        if not math.isfinite(value):
            raise self._error("a number that a computer can hold", start)
        found = _UNIT.match(self._text, self._at)
        if found is None:
            return Number(value)
        self._at = found.end()
        unit, factor = UNITS[found[1]]
        return Number(value * factor, unit)

    def _parse_time(self) -> float:
        """Parse a time window, s."""
        if self._peek()[0] != "number":
            raise self._error("a time such as 3 s")
        start = self._peek()[2]
        number = self._parse_number()
        if number.unit is None:
            raise self._error("a unit behind the time, such as s")
        if number.unit != "s":
            raise self._error("a time such as 3 s", start)
        if not 0.0 < number.value <= MAX_WINDOW_S:
            raise self._error(f"a time above 0 s and up to {MAX_WINDOW_S:g} s", start)
        return number.value

    def _peek(self) -> tuple[str, str, int]:
        """Return kind, text and start of the next token; its kind is `end` beyond the last one."""
        rest = self._text[self._at :]
        start = self._at + len(rest) - len(rest.lstrip())
        if not rest.strip():
            return ("end", "", len(self._text))
        match = _TOKEN.match(self._text, self._at)
        if match is None or match.lastgroup is None:
            return ("other", self._text[start : start + 1], start)
        return (match.lastgroup, match[match.lastgroup], match.start(match.lastgroup))

    def _next(self) -> tuple[str, str, int]:
        """Consume the next token."""
        token = self._peek()
        self._at = token[2] + len(token[1])
        return token

    def _take(self, kind: str, text: str) -> bool:
        """Consume the next token if it has this kind and text; return whether it had."""
        if self._peek()[:2] != (kind, text):
            return False
        self._next()
        return True

    def _require(self, text: str) -> None:
        if not self._take("sign", text):
            raise self._error(f"`{text}`")

    def _error(self, expected: str, start: int | None = None) -> UsageError:
        """Return the syntax error that says what was expected at a character, and what is there."""
        start = self._peek()[2] if start is None else start
        found = self._text[start : start + 20].strip()
        what = f"found `{found}`" if found else "it ends"
        return UsageError(
            f"can't read the expression `{self._text.strip()}`: expected {expected} at character {start + 1}, {what}",
            hint=EXAMPLE,
        )
