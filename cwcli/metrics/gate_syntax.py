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
    Token,
)

GATE_FUNCTIONS = ("mean", "median", "min", "max", "sum", "pooled")
"""Functions of a metric's values in all logs; percentiles such as `p95` come on top."""
GATE_EXAMPLE = "for example 'ego.position_rmse_m < 0.5 and pooled(warnings.recall) >= 0.9'"
"""A valid gate, which the hints of syntax errors show."""

_TOKEN_PATTERN = re.compile(
    rf"\s*(?:{NUMBER_PATTERN}%?)|(?P<name>[A-Za-z*][A-Za-z0-9_.*-]*)|{COMPARISON_OPERATOR_OR_PARENTHESIS_PATTERN})"
)
"""Pattern of one token, a number, a name or a sign, after any white space."""
_PERCENTILE_PATTERN = re.compile(r"p(\d{1,2})")
"""Pattern of the functions for percentiles: `p` and one or two digits."""


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
    """A function of a metric's values in all logs: one of `GATE_FUNCTIONS`, or `p95` and so on."""

    function: str
    name: Name


@dataclass(frozen=True)
class Share:
    """Share of the logs for which a gate holds."""

    inner: Node


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
    return _Parser(text).parse_whole_gate()


def metric_names_in_gate(text: str) -> tuple[str, ...]:
    """Return every name in a gate, also its functions and words; () if it is no gate, which checking it will say."""
    return tuple(token["name"] for token in _TOKEN_PATTERN.finditer(text) if token["name"])


def needs_single_log(node: Node | Operand) -> bool:
    """Return whether a node is about single logs: it has a metric outside of functions, `any`, `all` and `share`."""
    if isinstance(node, Comparison):
        return any(isinstance(operand, Name) for operand in node.operands)
    if isinstance(node, Not):
        return needs_single_log(node.inner)
    return isinstance(node, AndOr) and any(needs_single_log(part) for part in node.parts)


class _Parser(ConditionParser):
    """The parser of the grammar above."""

    what, example, token = "a gate", GATE_EXAMPLE, _TOKEN_PATTERN

    def parse_whole_gate(self) -> Node:
        """Parse `gate` up to the end of the text."""
        while self.next_token_without_taking_it()[0] != "end":
            kind, _, start = self.next_token()
            if kind == "other":
                raise self.error_at_token("a metric, a number or a comparison", start)
        self.at = 0
        node: Node = self.parse_to_end("`and`, `or` or the end")
        return node

    def parse_term(self) -> Node:
        """Parse a gate in parentheses, `over` or `comparison` of the grammar."""
        if self.next_token_without_taking_it()[1] == "(":
            node: Node = self.parse_in_parentheses()
            return node
        start, quantifier = self.at, self.next_token()[1]
        if quantifier in {"any", "all"} and self.next_token_without_taking_it()[1] == "(":
            return AnyAll(quantifier, self._parse_gate_of_single_logs())
        self.at = start
        comparison = self.parse_comparison()
        names = [o.name if isinstance(o, Aggregate) else o for o in comparison.operands]
        if sum(isinstance(name, Name) and name.is_pattern for name in names) > 1:
            raise UsageError(f"the gate compares two patterns with *: {self.text.strip()}", hint="use * once")
        return comparison

    def parse_operand(self) -> Operand:
        """Parse `operand` of the grammar."""
        kind, text, start = self._next_token("a metric or a number")
        if kind == "number":
            return Number(self.finite_number(text.removesuffix("%"), start) / (100.0 if text.endswith("%") else 1.0))
        if kind != "name" or text in LOGICAL_WORDS:
            raise self.error_at_token("a metric or a number", start)
        if self.next_token_without_taking_it()[1] != "(":
            return Name(text)
        if text == "share":
            return Share(self._parse_gate_of_single_logs())
        if text not in GATE_FUNCTIONS and not _PERCENTILE_PATTERN.fullmatch(text):
            known = (*GATE_FUNCTIONS, "p95", "share", "any", "all")
            raise UsageError(
                f"a gate has no function {text}", hint=hint_at_closest_or_all_known_names(text, known, "known")
            )
        self.require_sign("(")
        kind, inner, start = self._next_token("a metric")
        if kind != "name" or self.next_token_without_taking_it()[1] == "(":
            raise self.error_at_token("a metric", start)
        self.require_sign(")")
        return Aggregate(text, Name(inner))

    def _parse_gate_of_single_logs(self) -> Node:
        """Parse a gate in parentheses that must be about single logs."""
        node: Node = self.parse_in_parentheses()
        if not needs_single_log(node):
            raise UsageError(f"any(), all() and share() need a metric of a log inside: {self.text.strip()}")
        return node

    def _next_token(self, expected: str) -> Token:
        """Consume the next token; raise `UsageError` at the end, which names what was expected."""
        if self.next_token_without_taking_it()[0] == "end":
            raise self.error_at_token(expected)
        return self.next_token()


def percentile_of_function(function: str) -> float | None:
    """Return the percentile that a function such as `p95` computes; None for another function."""
    match = _PERCENTILE_PATTERN.fullmatch(function)
    return float(match[1]) if match else None
