"""The grammar of gates. An expression is parsed into the nodes below; nothing of it is ever run as code.

gate       = and { "or" and }
and        = not { "and" not }
not        = "not" not | "(" gate ")" | over | comparison
over       = ("any" | "all") "(" gate ")"
comparison = operand compare operand [ compare operand ]
operand    = number [ "%" ] | metric | function "(" metric ")" | "share" "(" gate ")"
function   = "mean" | "median" | "min" | "max" | "sum" | "pooled" | "p" digits
compare    = "<" | "<=" | ">" | ">=" | "==" | "!="
metric     = a name such as ego.position_rmse_m; * stands for any characters
"""

from __future__ import annotations

import math
import re

from cwcli.errors import UsageError, names_hint
from cwcli.lazy_dataclass import dataclass

MAX_LENGTH = 2000
"""Greatest number of characters of a gate; chosen by hand."""
MAX_DEPTH = 50
"""Greatest depth of nested parentheses, which bounds the recursion of the parser; chosen by hand."""
FUNCTIONS = ("mean", "median", "min", "max", "sum", "pooled")
"""Functions of a metric's values in all logs; percentiles such as `p95` come on top."""
COMPARISONS = ("<=", ">=", "==", "!=", "<", ">")
"""The comparison operators of a gate."""
EXAMPLE = "for example 'ego.position_rmse_m < 0.5 and pooled(warnings.recall) >= 0.9'"
"""A valid gate, which the hints of syntax errors show."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?%?)"
    r"|(?P<name>[A-Za-z*][A-Za-z0-9_.*-]*)"
    r"|(?P<sign><=|>=|==|!=|<|>|\(|\)))"
)
"""Pattern of one token, a number, a name or a sign, after any white space."""
_PERCENTILE = re.compile(r"p(\d{1,2})")
"""Pattern of the functions for percentiles: `p` and one or two digits."""


@dataclass(frozen=True)
class Number:
    """A constant."""

    value: float


@dataclass(frozen=True)
class Name:
    """A metric of one log, or all that a pattern with `*` matches."""

    text: str

    @property
    def is_pattern(self) -> bool:
        """Whether the name is a pattern, which may match several metrics."""
        return "*" in self.text


@dataclass(frozen=True)
class Aggregate:
    """A function of a metric's values in all logs: one of `FUNCTIONS`, or `p95` and so on."""

    function: str
    name: Name


@dataclass(frozen=True)
class Share:
    """Share of the logs for which a gate holds."""

    inner: Node


@dataclass(frozen=True)
class Comparison:
    """A comparison, `left sign right` or a chain of two; it has one operand more than signs."""

    operands: tuple[Operand, ...]
    signs: tuple[str, ...]


@dataclass(frozen=True)
class Not:
    """The negation of a gate."""

    inner: Node


@dataclass(frozen=True)
class AndOr:
    """A conjunction (`is_and`) or disjunction of gates."""

    parts: tuple[Node, ...]
    is_and: bool


@dataclass(frozen=True)
class AnyAll:
    """Whether a gate holds for `any` or for `all` logs."""

    quantifier: str
    inner: Node


Operand = Number | Name | Aggregate | Share
Node = Comparison | Not | AndOr | AnyAll


def parse_gate(text: str) -> Node:
    """Parse a gate.

    Raises:
        UsageError: It is no gate; the message says where and what was expected.
    """
    if len(text) > MAX_LENGTH:
        raise UsageError(f"a gate of {len(text)} characters is longer than {MAX_LENGTH}", hint=EXAMPLE)
    return _Parser(text).parse_whole_gate()


def needs_single_log(node: Node | Operand) -> bool:
    """Return whether a node is about single logs: it has a metric outside of functions, `any`, `all` and `share`."""
    if isinstance(node, Comparison):
        return any(isinstance(operand, Name) for operand in node.operands)
    if isinstance(node, Not):
        return needs_single_log(node.inner)
    return isinstance(node, AndOr) and any(needs_single_log(part) for part in node.parts)


class _Parser:
    """A recursive-descent parser over tokens of kind, text and start."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = self._split_into_tokens(text)
        self._at = 0
        self._depth = 0

    def _split_into_tokens(self, text: str) -> list[tuple[str, str, int]]:
        """Return kind, text and start of each token."""
        tokens = []
        at = 0
        while at < len(text.rstrip()):
            match = _TOKEN.match(text, at)
            if match is None or match.lastgroup is None:
                start = at + len(text[at:]) - len(text[at:].lstrip())
                raise self._syntax_error("a metric, a number or a comparison", start)
            tokens.append((match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)))
            at = match.end()
        return tokens

    def parse_whole_gate(self) -> Node:
        """Parse `gate` up to the end of the text."""
        node = self._parse_or()
        if self._at < len(self._tokens):
            raise self._unexpected_token_error("`and`, `or` or the end")
        return node

    def _parse_or(self) -> Node:
        """Parse `gate` of the grammar."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise UsageError(f"the gate has more than {MAX_DEPTH} parentheses inside each other")
        parts = [self._parse_and()]
        while self._take_token_if("name", "or"):
            parts.append(self._parse_and())
        self._depth -= 1
        return parts[0] if len(parts) == 1 else AndOr(tuple(parts), is_and=False)

    def _parse_and(self) -> Node:
        """Parse `and` of the grammar."""
        parts = [self._parse_not()]
        while self._take_token_if("name", "and"):
            parts.append(self._parse_not())
        return parts[0] if len(parts) == 1 else AndOr(tuple(parts), is_and=True)

    def _parse_not(self) -> Node:
        """Parse `not` of the grammar; two negations cancel each other."""
        negations = 0
        while self._take_token_if("name", "not"):
            negations += 1
        node = self._parse_condition()
        return Not(node) if negations % 2 else node

    def _parse_condition(self) -> Node:
        """Parse a gate in parentheses, `over` or `comparison` of the grammar."""
        if self._take_token_if("sign", "("):
            node = self._parse_or()
            self._require_token(")")
            return node
        if (
            self._peek_token()[0] == "name"
            and self._peek_token()[1] in {"any", "all"}
            and self._peek_token(1)[1] == "("
        ):
            quantifier = self._next_token()[1]
            return AnyAll(quantifier, self._parse_parentheses())
        return self._parse_comparison()

    def _parse_comparison(self) -> Comparison:
        """Parse `comparison` of the grammar, and refuse one of numbers alone or of two patterns."""
        operands = [self._parse_operand()]
        signs: list[str] = []
        while self._peek_token()[1] in COMPARISONS and len(signs) < 2:
            signs.append(self._next_token()[1])
            operands.append(self._parse_operand())
        if not signs:
            raise self._unexpected_token_error(f"one of {' '.join(COMPARISONS)}")
        names = [o.name if isinstance(o, Aggregate) else o for o in operands]
        if all(isinstance(operand, Number) for operand in operands):
            raise UsageError(f"the gate compares numbers only: {self._text.strip()}", hint=EXAMPLE)
        if sum(isinstance(name, Name) and name.is_pattern for name in names) > 1:
            raise UsageError(f"the gate compares two patterns with *: {self._text.strip()}", hint="use * once")
        return Comparison(tuple(operands), tuple(signs))

    def _parse_operand(self) -> Operand:
        """Parse `operand` of the grammar."""
        kind, text, start = self._next_token("a metric or a number")
        if kind == "number":
            value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
            if not math.isfinite(value):  # would always hold, or never
                raise self._syntax_error("a number that a computer can hold", start)
            return Number(value)
        if kind != "name" or text in {"and", "or", "not"}:
            raise self._syntax_error("a metric or a number", start)
        if self._peek_token()[1] != "(":
            return Name(text)
        if text == "share":
            return Share(self._parse_parentheses())
        if text not in FUNCTIONS and not _PERCENTILE.fullmatch(text):
            known = (*FUNCTIONS, "p95", "share", "any", "all")
            raise UsageError(f"a gate has no function {text}", hint=names_hint(text, known, "known"))
        self._require_token("(")
        kind, inner, start = self._next_token("a metric")
        if kind != "name" or self._peek_token()[1] == "(":
            raise self._syntax_error("a metric", start)
        self._require_token(")")
        return Aggregate(text, Name(inner))

    def _parse_parentheses(self) -> Node:
        """Parse a gate in parentheses that must be about single logs."""
        self._require_token("(")
        node = self._parse_or()
        self._require_token(")")
        if not needs_single_log(node):
            raise UsageError(f"any(), all() and share() need a metric of a log inside: {self._text.strip()}")
        return node

    def _peek_token(self, ahead: int = 0) -> tuple[str, str, int]:
        """Return a token ahead without consuming it; its kind is `end` beyond the last one."""
        at = self._at + ahead
        return self._tokens[at] if at < len(self._tokens) else ("end", "", len(self._text))

    def _next_token(self, expected: str = "more") -> tuple[str, str, int]:
        """Consume the next token; raise `UsageError` at the end, which names what was expected."""
        if self._at >= len(self._tokens):
            raise self._unexpected_token_error(expected)
        self._at += 1
        return self._tokens[self._at - 1]

    def _take_token_if(self, kind: str, text: str) -> bool:
        """Consume the next token if it has this kind and text; return whether it had."""
        if self._peek_token()[:2] != (kind, text):
            return False
        self._at += 1
        return True

    def _require_token(self, text: str) -> None:
        """Consume a sign; raise `UsageError` if the next token is another one."""
        if not self._take_token_if("sign", text):
            raise self._unexpected_token_error(f"`{text}`")

    def _unexpected_token_error(self, expected: str) -> UsageError:
        """Return the syntax error at the next token."""
        return self._syntax_error(expected, self._peek_token()[2])

    def _syntax_error(self, expected: str, start: int) -> UsageError:
        """Return the error that says what was expected at a character, and what is there."""
        found = self._text[start : start + 20].strip()
        found = "a URL" if "://" in self._text else found  # a part of one could be a part of its password
        what = f"found `{found}`" if found else "it ends"
        return UsageError(
            f"can't read the gate `{self._text.strip()}`: expected {expected} at character {start + 1}, {what}",
            hint=EXAMPLE,
        )


def percentile_of_function(function: str) -> float | None:
    """Return the percentile that a function such as `p95` computes; None for another function."""
    match = _PERCENTILE.fullmatch(function)
    return float(match[1]) if match else None
