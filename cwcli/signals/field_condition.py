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
from dataclasses import dataclass
from enum import Enum

from cwcli.errors import UsageError

MAX_LENGTH = 500
"""The largest number of characters of a condition; chosen by hand."""
MAX_STEPS = 64
"""The largest number of path steps of a condition; chosen by hand."""
EXAMPLES = "for example data==true, level>=2, objects[0].ttc<1.5 or status[name=='fcw'].values[key==state].value==warn"
"""The hint with examples that every syntax error shows."""
COMPARE: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
"""The comparison function, by its sign."""
_TOKEN = re.compile(
    r"""\s*(?:(?P<sign><=|>=|==|!=|<|>)|(?P<mark>[.\[\]])|(?P<name>[A-Za-z_]\w*)"""
    r"""|(?P<index>-?\d{1,9}(?=\s*\]))|(?P<bad>\S))"""
)
"""The pattern of the next token of a path."""
_VALUE = re.compile(r"""\s*(?:"(?P<double>[^"]*)"|'(?P<single>[^']*)'|(?P<word>[^\s\]\["'<>=!]+))\s*""")
"""The pattern of the value behind a comparison sign."""
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
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
    def plain_path(self) -> str:
        """The dotted path of a field outside of lists; "" for another one."""
        return ".".join(each for each in self.path if isinstance(each, str)) if self.is_plain else ""

    @property
    def is_plain(self) -> bool:
        """Whether no list is on the way."""
        return all(isinstance(each, str) for each in self.path)


class Missing(Enum):
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
    if len(text) > MAX_LENGTH:
        raise UsageError(f"a condition of {len(text)} characters is longer than {MAX_LENGTH}", hint=EXAMPLES)
    parser = _Parser(text)
    condition = parser.condition()
    if parser.at < len(text.rstrip()):
        raise parser.error("the end")
    return condition


def value_at(message: object, path: tuple[str | int | Condition, ...]) -> object:
    """Return the value at a path of a message: a dictionary, list, number, truth value, text or None.

    Returns:
        The value, or why it is missing.
    """
    at = message
    for step in path:
        if isinstance(step, str):
            if not isinstance(at, dict) or step not in at:
                return Missing.FIELD
            at = at[step]
        elif not isinstance(at, list):
            return Missing.FIELD
        elif isinstance(step, int):
            if not -len(at) <= step < len(at):
                return Missing.ELEMENT
            at = at[step]
        else:
            chosen = [holds(value_at(each, step.path), step) for each in at]
            if True not in chosen:
                return Missing.ELEMENT
            at = at[chosen.index(True)]
    return at


def holds(value: object, condition: Condition) -> bool | None:
    """Return whether a value meets a condition; None where the two can't be compared.

    A value that is absent or not a number (NaN) meets none. Texts that spell a number are compared as numbers where the
    condition has one; `true` is true, a number that is not 0, and the text `true` in any case.
    """
    asked = condition.value
    if value is None or isinstance(value, Missing) or (isinstance(value, float) and math.isnan(value)):
        return False
    if isinstance(asked, bool):
        truth = _truth(value)
        return None if truth is None else (truth == asked) == (condition.sign == "==")
    if isinstance(asked, str):
        return (value == asked) == (condition.sign == "==") if isinstance(value, str) else None
    return _against_number(value, condition.sign, asked)


def _against_number(value: object, sign: str, asked: float) -> bool | None:
    if isinstance(value, str):
        spelled = value.strip()
        if not _NUMBER.fullmatch(spelled):
            return sign == "!=" if sign in ("==", "!=") else None
        value = float(spelled)
    if not isinstance(value, int | float):  # a list, or an object
        return None
    return COMPARE[sign](value, asked)


def _truth(value: object) -> bool | None:
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

    def condition(self) -> Condition:
        begin = self.at
        path: list[str | int | Condition] = [self._name()]
        while True:
            kind, token = self._peek()
            if kind == "sign":
                break
            if token == ".":
                self._next()
                path.append(self._name())
            elif token == "[":
                self._next()
                path.append(self._choice())
            else:
                raise self.error(f"`.`, `[` or one of {' '.join(COMPARE)}")
            self.n_steps += 1
            if self.n_steps > MAX_STEPS:
                raise UsageError(f"the condition has more than {MAX_STEPS} steps: {self.text[:40]}...")
        _, sign = self._next()
        value = self._value(sign)
        return Condition(tuple(path), sign, value, self.text[begin : self.at].strip())

    def _choice(self) -> int | Condition:
        kind, token = self._peek()
        if kind == "index":
            self._next()
            chosen: int | Condition = int(token)
        else:
            chosen = self.condition()
        if self._peek()[1] != "]":
            raise self.error("`]`")
        self._next()
        return chosen

    def _name(self) -> str:
        kind, token = self._peek()
        if kind != "name":
            raise self.error("the name of a field")
        self._next()
        return token

    def _value(self, sign: str) -> Value:
        match = _VALUE.match(self.text, self.at)
        if match is None:
            raise self.error("a number, true, false or a text")
        start, self.at = self.at, match.end()
        word = match["word"]
        value: Value
        if word is None:
            value = match["double"] if match["double"] is not None else match["single"]
        elif _NUMBER.fullmatch(word):
            value = float(word)
        else:
            value = {"true": True, "false": False}.get(word.lower(), word)
        if (not math.isfinite(value)) if isinstance(value, float) else (sign not in ("==", "!=")):
            self.at = start
            raise self.error(f"a number behind `{sign}`")
        return value

    def _peek(self) -> tuple[str, str]:
        match = _TOKEN.match(self.text, self.at)
        if match is None or match.lastgroup is None:
            return "end", ""
        return match.lastgroup, match[match.lastgroup]

    def _next(self) -> tuple[str, str]:
        match = _TOKEN.match(self.text, self.at)
        assert match is not None and match.lastgroup is not None
        self.at = match.end()
        return match.lastgroup, match[match.lastgroup]

    def error(self, expected: str) -> UsageError:
        rest = self.text[self.at :]
        start = self.at + len(rest) - len(rest.lstrip())
        found = self.text[start : start + 20].strip()
        what = f"found `{found}`" if found else "it ends"
        shown = self.text.strip()
        return UsageError(
            f"can't read the condition `{shown}`: expected {expected} at character {start + 1}, {what}", hint=EXAMPLES
        )
