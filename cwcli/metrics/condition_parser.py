"""What the grammars of conditions have in common: tokens, `and`, `or`, `not`, parentheses, comparisons and errors.

The gates (`cwcli.metrics.gate_syntax`) and what is looked for in logs (`cwcli.events.syntax`) build on it. Nothing of a
condition is ever run as code.

condition  = and { "or" and }
and        = not { "and" not }
not        = "not" not | term
comparison = operand compare operand [ compare operand ]
compare    = "<" | "<=" | ">" | ">=" | "==" | "!="
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from typing import Any, ClassVar

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.signals.field_condition import COMPARISONS_BY_SIGN

MAX_CONDITION_CHARACTERS = 2000
"""Greatest number of characters of a condition; chosen by hand."""
MAX_PARENTHESIS_NESTING = 50
"""Greatest depth of nested parentheses, which bounds the recursion of the parser; chosen by hand."""
NUMBER_PATTERN = r"(?P<number>[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
"""Pattern of a number, without the parenthesis at its end: a grammar may allow a sign behind it."""
COMPARISON_OPERATOR_OR_PARENTHESIS_PATTERN = r"(?P<sign><=|>=|==|!=|<|>|\(|\))"
"""Pattern of a comparison operator or a parenthesis."""
LOGICAL_WORDS = frozenset({"and", "or", "not"})
"""Words that are no names."""

Token = tuple[str, str, int]
"""The type of a token: its kind, its text, and where it starts."""


@dataclass(frozen=True)
class Number:
    """A constant; with a unit its value is in the SI unit of that name."""

    value: float
    unit: str | None = None


@dataclass(frozen=True)
class Comparison:
    """A comparison, `left sign right` or a chain of two; it has one operand more than signs."""

    operands: tuple[Any, ...]
    signs: tuple[str, ...]


@dataclass(frozen=True)
class Not:
    """The negation of a condition, a node of its grammar."""

    inner: Any


@dataclass(frozen=True)
class AndOr:
    """A conjunction (`is_and`) or disjunction of conditions, nodes of their grammar."""

    parts: tuple[Any, ...]
    is_and: bool


class ConditionParser(ABC):
    """A recursive-descent parser; a grammar adds the terms that `not`, `and` and `or` join.

    Attributes:
        what: What is parsed, with its article, for errors.
        example: A hint with valid examples.
        token: Pattern of one token after any white space, with a group for each kind.
    """

    what: ClassVar[str]
    example: ClassVar[str]
    token: ClassVar[re.Pattern[str]]

    def __init__(self, text: str) -> None:
        if len(text) > MAX_CONDITION_CHARACTERS:
            raise UsageError(
                f"{self.what} of {len(text)} characters is longer than {MAX_CONDITION_CHARACTERS}", hint=self.example
            )
        self.text = text
        self.at = 0
        self._depth = 0

    def parse_to_end(self, expected: str) -> Any:
        """Parse `condition` of the grammar up to the end of the text; an error names what was expected there."""
        node = self.parse_condition()
        if self.next_token_without_taking_it()[0] != "end":
            raise self.error_at_token(expected)
        return node

    def parse_in_parentheses(self) -> Any:
        """Parse `"(" condition ")"`."""
        self.require_sign("(")
        node = self.parse_condition()
        self.require_sign(")")
        return node

    @abstractmethod
    def parse_term(self) -> Any:
        """Parse what `not`, `and` and `or` join."""

    def parse_condition(self) -> Any:
        """Parse `condition` of the grammar."""
        self._depth += 1
        if self._depth > MAX_PARENTHESIS_NESTING:
            raise UsageError(f"the {self._noun} has more than {MAX_PARENTHESIS_NESTING} parentheses inside each other")
        parts = [self._parse_and()]
        while self.take_if_next("name", "or"):
            parts.append(self._parse_and())
        self._depth -= 1
        return parts[0] if len(parts) == 1 else AndOr(tuple(parts), is_and=False)

    def _parse_and(self) -> Any:
        parts = [self._parse_not()]
        while self.take_if_next("name", "and"):
            parts.append(self._parse_not())
        return parts[0] if len(parts) == 1 else AndOr(tuple(parts), is_and=True)

    def _parse_not(self) -> Any:
        """Parse `not` of the grammar; two negations cancel each other."""
        negations = 0
        while self.take_if_next("name", "not"):
            negations += 1
        node = self.parse_term()
        return Not(node) if negations % 2 else node

    @abstractmethod
    def parse_operand(self) -> Any:
        """Parse one side of a comparison."""

    def parse_comparison(self) -> Comparison:
        """Parse a comparison or a chain of two, which is not of numbers alone."""
        operands = [self.parse_operand()]
        signs: list[str] = []
        while self.next_token_without_taking_it()[1] in COMPARISONS_BY_SIGN and len(signs) < 2:
            signs.append(self.next_token()[1])
            operands.append(self.parse_operand())
        if not signs:
            raise self.error_without_sign(operands[0])
        if all(isinstance(operand, Number) for operand in operands):
            raise UsageError(f"the {self._noun} compares numbers only: {self.text.strip()}", hint=self.example)
        return Comparison(tuple(operands), tuple(signs))

    def error_without_sign(self, operand: Any) -> UsageError:
        """Return the error about an operand that is compared with nothing."""
        return self.error_at_token(f"one of {' '.join(COMPARISONS_BY_SIGN)}")

    def finite_number(self, text: str, start: int) -> float:
        """Return the value of a number; refuse one that overflows: it would always hold, or never."""
        value = float(text)
        if not math.isfinite(value):
            raise self.error_at_token("a number that a computer can hold", start)
        return value

    def next_token_without_taking_it(self) -> Token:
        """Return the next token; its kind is `end` beyond the last one, and `other` where nothing fits."""
        rest = self.text[self.at :]
        start = self.at + len(rest) - len(rest.lstrip())
        if not rest.strip():
            return ("end", "", len(self.text))
        match = self.token.match(self.text, self.at)
        if match is None or match.lastgroup is None:
            return ("other", self.text[start : start + 1], start)
        return (match.lastgroup, match[match.lastgroup], match.start(match.lastgroup))

    def next_token(self) -> Token:
        """Consume the next token."""
        token = self.next_token_without_taking_it()
        self.at = token[2] + len(token[1])
        return token

    def take_if_next(self, kind: str, text: str) -> bool:
        """Consume the next token if it has this kind and text; return whether it had."""
        if self.next_token_without_taking_it()[:2] != (kind, text):
            return False
        self.next_token()
        return True

    def require_sign(self, text: str) -> None:
        """Consume a sign; raise `UsageError` if the next token is another one."""
        if not self.take_if_next("sign", text):
            raise self.error_at_token(f"`{text}`")

    def error_at_token(self, expected: str, start: int | None = None) -> UsageError:
        """Return the error that says what was expected at a character, by default that of the next token."""
        start = self.next_token_without_taking_it()[2] if start is None else start
        found = self.text[start : start + 20].strip()
        found = "a URL" if "://" in self.text else found  # a part of one could be a part of its password
        what = f"found `{found}`" if found else "it ends"
        return UsageError(
            f"can't read the {self._noun} `{self.text.strip()}`: expected {expected} at character {start + 1}, {what}",
            hint=self.example,
        )

    @property
    def _noun(self) -> str:
        """What is parsed, without its article."""
        return self.what.partition(" ")[2]
