"""Conditions on fields of messages."""

from __future__ import annotations

import contextlib
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cwcli.errors import UsageError
from cwcli.signals.field_condition import Condition, MissingValue, meets_condition, parse_condition, value_at_path


@pytest.mark.parametrize(
    ("text", "path", "sign", "value"),
    [
        ("data==true", ("data",), "==", True),
        (" a . b_2 != FALSE ", ("a", "b_2"), "!=", False),
        ("a[0].b<=-1.5e3", ("a", 0, "b"), "<=", -1500.0),
        ("a[-1] > .5", ("a", -1), ">", 0.5),
        ("state=='it is, so'", ("state",), "==", "it is, so"),
        ('state=="]["', ("state",), "==", "]["),
        ("state==adas/fcw:2", ("state",), "==", "adas/fcw:2"),
        ("state=='2'", ("state",), "==", "2"),
        ("a==''", ("a",), "==", ""),
    ],
)
def test_what_is_parsed(text: str, path: tuple[Any, ...], sign: str, value: object) -> None:
    found = parse_condition(text)
    assert (found.path, found.sign, found.value) == (path, sign, value)
    assert type(found.value) is type(value)


def test_a_condition_inside_chooses_an_element() -> None:
    found = parse_condition("status[name==fcw].values[key=='ttc'].value<1.5")
    assert found.path == (
        "status",
        Condition(("name",), "==", "fcw", "name==fcw"),
        "values",
        Condition(("key",), "==", "ttc", "key=='ttc'"),
        "value",
    )
    message = {"status": [{"name": "x"}, {"name": "fcw", "values": [{"key": "ttc", "value": "1.2"}]}]}
    assert value_at_path(message, found.path) == "1.2"
    assert meets_condition("1.2", found) is True


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("", "the name of a field at character 1, it ends"),
        ("data", "expected `.`, `[` or one of <= >= == != < > at character 5, it ends"),
        ("data=1", "at character 5, found `=1`"),
        ("data==", "a number, true, false or a text at character 7, it ends"),
        ("data<true", "a number behind `<`"),
        ("data>=high", "a number behind `>=`"),
        ("data==1e999", "a number behind `==`"),
        ("data==1 or x==2", "expected the end at character 9"),
        ("a[1==2", "the name of a field at character 3"),
        ("a[b==1.c", "`]` at character 9, it ends"),
        ("__import__('os').system('ls')", "found `('os').system('ls')`"),
        ("a[b[c==1]", "at character 10, it ends"),
        ("a[b]==1", "found `]==1`"),
        ("1==1", "the name of a field"),
    ],
)
def test_what_is_no_condition_is_told_with_its_place(text: str, where: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_condition(text)
    assert where in str(caught.value)


@given(st.text(max_size=80))
def test_any_text_is_a_condition_or_a_usage_error(text: str) -> None:
    with contextlib.suppress(UsageError):
        parse_condition(text)


def test_long_and_deep_texts_are_refused() -> None:
    with pytest.raises(UsageError, match="longer than"):
        parse_condition("a" * 501 + "==1")
    with pytest.raises(UsageError):
        parse_condition("a[" * 240 + "b")


@pytest.mark.parametrize(
    ("value", "text", "expected"),
    [
        (True, "x==true", True),
        (False, "x!=true", True),
        (2, "x==true", True),
        (0.0, "x==false", True),
        ("True", "x==true", True),
        ("on", "x==true", None),
        (3, "x>=3", True),
        (True, "x==1", True),
        ("3.5", "x>3", True),
        ("abc", "x>3", None),
        ("abc", "x==3", False),
        ("abc", "x!=3", True),
        ("3", "x=='3'", True),
        (3, "x=='3'", None),
        (math.nan, "x!=3", False),
        (math.nan, "x<3", False),
        (math.inf, "x>3", True),
        (None, "x!=3", False),
        (MissingValue.FIELD, "x!=3", False),
        ([1], "x==1", None),
        ({}, "x==1", None),
    ],
)
def test_what_is_compared(value: object, text: str, expected: bool | None) -> None:
    assert meets_condition(value, parse_condition(text)) is expected


@pytest.mark.parametrize(
    ("message", "text", "expected"),
    [
        ({"a": {"b": 1}}, "a.b==1", 1),
        ({"a": {"b": 1}}, "a.c==1", MissingValue.FIELD),
        ({"a": 1}, "a.b==1", MissingValue.FIELD),
        ({"a": [1, 2]}, "a[1]==1", 2),
        ({"a": [1, 2]}, "a[2]==1", MissingValue.ELEMENT),
        ({"a": [1, 2]}, "a[-2]==1", 1),
        ({"a": [1, 2]}, "a[-3]==1", MissingValue.ELEMENT),
        ({"a": 1}, "a[0]==1", MissingValue.FIELD),
        ({"a": [{"n": 1}, {"n": 2, "v": 5}]}, "a[n==2].v==1", 5),
        ({"a": [{"n": 1}]}, "a[n==2].v==1", MissingValue.ELEMENT),
        ([], "a==1", MissingValue.FIELD),
    ],
)
def test_what_stands_at_a_path(message: object, text: str, expected: object) -> None:
    assert value_at_path(message, parse_condition(text).path) == expected
