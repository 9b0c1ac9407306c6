"""Conditions on a field of a message, such as `status[name=='fcw'].level >= 2`: parsed, never run as code.

condition = path compare value
path      = name { "." name | "[" index "]" | "[" condition "]" }
compare   = "==" | "!=" | "<" | "<=" | ">" | ">="
value     = number | "true" | "false" | text in single or double quotes | a word of letters, digits, _ - . : /

`[2]` is the third element of a list, `[-1]` the last; `[name=='fcw']` is the first element for which that holds.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from enum import Enum
from typing import Any

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass

MAX_CONDITION_CHARACTERS = 500
"""The largest number of characters of a condition; chosen by hand."""
MAX_PATH_STEPS_OF_CONDITION = 64
"""The largest number of path steps of a condition; chosen by hand."""
CONDITION_EXAMPLES_HINT = (
    "for example data==true, level>=2, objects[0].ttc<1.5 or status[name=='fcw'].values[key==state].value==warn"
)
"""The hint with examples that every syntax error shows."""
COMPARISONS_BY_SIGN: dict[str, Callable[[Any, Any], Any]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
"""Sign of a comparison -> the function that evaluates it, on numbers or on arrays; NaN compares false."""
_TOKEN_PATTERN = re.compile(
    r"""\s*(?:(?P<sign><=|>=|==|!=|<|>)|(?P<mark>[.\[\]])|(?P<name>[A-Za-z_]\w*)"""
    r"""|(?P<index>-?\d{1,9}(?=\s*\]))|(?P<bad>\S))"""
)
"""The pattern of the next token of a path."""
_VALUE_PATTERN = re.compile(r"""\s*(?:"(?P<double>[^"]*)"|'(?P<single>[^']*)'|(?P<word>[^\s\]\["'<>=!]+))\s*""")
"""The pattern of the value behind a comparison sign."""
_NUMBER_PATTERN = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
"""The pattern of a number."""

Value = float | bool | str


@dataclass(frozen=True)
class Condition:
    """A comparison that a message, or an element of a list in it, can meet.

    Attributes:
        path: Names, numbers of elements, and conditions that choose an element.
        sign: The comparison sign.
        value: The value that the field is compared with.
        text: The condition as it was written.
    """

    path: tuple[str | int | Condition, ...]
    sign: str
    value: Value
    text: str

    @property
    def dotted_path(self) -> str:
        """The dotted path of a field outside of lists; "" for another one."""
        return ".".join(each for each in self.path if isinstance(each, str)) if self.is_outside_lists else ""

    @property
    def is_outside_lists(self) -> bool:
        """Whether no list is on the way."""
        return all(isinstance(each, str) for each in self.path)


class MissingValue(Enum):
    """What is found instead of a value.

    FIELD: no such field. ELEMENT: a list has no such element, so the message says nothing of it.
    """

    FIELD = 1
    ELEMENT = 2


def parse_condition(text: str) -> Condition:
    """Parse a condition.

    Raises:
        UsageError: It is none; the message says where and what was expected.
    """
    if len(text) > MAX_CONDITION_CHARACTERS:
        raise UsageError(
            f"a condition of {len(text)} characters is longer than {MAX_CONDITION_CHARACTERS}",
            hint=CONDITION_EXAMPLES_HINT,
        )
    parser = _Parser(text)
    condition = parser.parse_condition()
    if parser.at < len(text.rstrip()):
        raise parser.syntax_error("the end")
    return condition


def value_at_path(message: object, path: tuple[str | int | Condition, ...]) -> object:
    """Return the value at a path of a message: a dictionary, list, number, truth value, text or None.

    Returns:
        The value, or why it is missing.
    """
    at = message
    for step in path:
        if isinstance(step, str):
            if not isinstance(at, dict) or step not in at:
                return MissingValue.FIELD
            at = at[step]
        elif not isinstance(at, list):
            return MissingValue.FIELD
        elif isinstance(step, int):
            if not -len(at) <= step < len(at):
                return MissingValue.ELEMENT
            at = at[step]
        else:
            chosen = [meets_condition(value_at_path(each, step.path), step) for each in at]
            if True not in chosen:
                return MissingValue.ELEMENT
            at = at[chosen.index(True)]
    return at


def meets_condition(value: object, condition: Condition) -> bool | None:
    """Return whether a value meets a condition; None where the two can't be compared.

    A value that is absent or not a number (NaN) meets none. Texts that spell a number are compared as numbers where the
    condition has one; `true` is true, a number that is not 0, and the text `true` in any case.
    """
    wanted_value = condition.value
    if value is None or isinstance(value, MissingValue) or (isinstance(value, float) and math.isnan(value)):
        return False
    if isinstance(wanted_value, bool):
        truth = _truth_value_or_none(value)
        return None if truth is None else (truth == wanted_value) == (condition.sign == "==")
    if isinstance(wanted_value, str):
        return (value == wanted_value) == (condition.sign == "==") if isinstance(value, str) else None
    return _compare_with_number(value, condition.sign, wanted_value)


def _compare_with_number(value: object, sign: str, number: float) -> bool | None:
    if isinstance(value, str):
        spelled = value.strip()
        if not _NUMBER_PATTERN.fullmatch(spelled):
            return sign == "!=" if sign in ("==", "!=") else None
        value = float(spelled)
    if not isinstance(value, int | float):  # a list, or an object
        return None
    return bool(COMPARISONS_BY_SIGN[sign](value, number))


def _truth_value_or_none(value: object) -> bool | None:
    if isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        return value != 0
    return {"true": True, "1": True, "false": False, "0": False}.get(value.lower()) if isinstance(value, str) else None


class _Parser:
    """A recursive-descent parser of the condition's text."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.n_steps = 0

    def parse_condition(self) -> Condition:
        begin = self.at
        path: list[str | int | Condition] = [self._parse_field_name()]
        while True:
            kind, token = self._peek_token_kind_and_text()
            if kind == "sign":
                break
            if token == ".":
                self._take_token_kind_and_text()
                path.append(self._parse_field_name())
            elif token == "[":
                self._take_token_kind_and_text()
                path.append(self._parse_index_or_condition())
            else:
                raise self.syntax_error(f"`.`, `[` or one of {' '.join(COMPARISONS_BY_SIGN)}")
            self.n_steps += 1
            if self.n_steps > MAX_PATH_STEPS_OF_CONDITION:
                raise UsageError(
                    f"the condition has more than {MAX_PATH_STEPS_OF_CONDITION} steps: {self.text[:40]}..."
                )
        _, sign = self._take_token_kind_and_text()
        value = self._parse_value(sign)
        return Condition(tuple(path), sign, value, self.text[begin : self.at].strip())

    def _parse_index_or_condition(self) -> int | Condition:
        kind, token = self._peek_token_kind_and_text()
        if kind == "index":
            self._take_token_kind_and_text()
            chosen: int | Condition = int(token)
        else:
            chosen = self.parse_condition()
        if self._peek_token_kind_and_text()[1] != "]":
            raise self.syntax_error("`]`")
        self._take_token_kind_and_text()
        return chosen

    def _parse_field_name(self) -> str:
        kind, token = self._peek_token_kind_and_text()
        if kind != "name":
            raise self.syntax_error("the name of a field")
        self._take_token_kind_and_text()
        return token

    def _parse_value(self, sign: str) -> Value:
        match = _VALUE_PATTERN.match(self.text, self.at)
        if match is None:
            raise self.syntax_error("a number, true, false or a text")
        start, self.at = self.at, match.end()
        word = match["word"]
        value: Value
        if word is None:
            value = match["double"] if match["double"] is not None else match["single"]
        elif _NUMBER_PATTERN.fullmatch(word):
            value = float(word)
        else:
            value = {"true": True, "false": False}.get(word.lower(), word)
        if (not math.isfinite(value)) if isinstance(value, float) else (sign not in ("==", "!=")):
            self.at = start
            raise self.syntax_error(f"a number behind `{sign}`")
        return value

    def _peek_token_kind_and_text(self) -> tuple[str, str]:
        match = _TOKEN_PATTERN.match(self.text, self.at)
        if match is None or match.lastgroup is None:
            return "end", ""
        return match.lastgroup, match[match.lastgroup]

    def _take_token_kind_and_text(self) -> tuple[str, str]:
        match = _TOKEN_PATTERN.match(self.text, self.at)
        assert match is not None and match.lastgroup is not None
        self.at = match.end()
        return match.lastgroup, match[match.lastgroup]

    def syntax_error(self, expected: str) -> UsageError:
        rest = self.text[self.at :]
        start = self.at + len(rest) - len(rest.lstrip())
        found = self.text[start : start + 20].strip()
        what = f"found `{found}`" if found else "it ends"
        shown = self.text.strip()
        return UsageError(
            f"can't read the condition `{shown}`: expected {expected} at character {start + 1}, {what}",
            hint=CONDITION_EXAMPLES_HINT,
        )
