"""Converts plain option values without pydantic, so that commands start faster.

Typer converts every value with a pydantic adapter, and importing pydantic takes as long as importing numpy (95 ms).
Text needs no conversion, a number only `int` or `float`. Other values are left to Typer.
"""

from __future__ import annotations

import math
from typing import Any, Literal, get_args, get_origin

from cwcli.cli.options import lazy_typer as typer
from cwcli.errors import hint_at_closest_or_all_known_names


class _PlainCoercion:
    """Replaces Typer's runtime parameter with one that converts plain values without pydantic."""

    def __init__(self, parameter: Any) -> None:
        self._annotation = parameter.type_descriptor.annotation
        self._info = parameter.type_descriptor.parameter_info
        self._parameter = parameter

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Convert a value to the declared type."""
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        plain = coerce_plain_value(self._annotation, value)
        if is_non_finite(plain):
            raise typer.BadParameter(f"{value} is not a finite number")
        if plain is not VALUE_FOR_TYPER_TO_CONVERT and is_within_bounds(plain, self._info.min, self._info.max):
            return plain
        self._parameter._runtime_param = None
        full = self._parameter.get_runtime_param()
        self._parameter._runtime_param = self
        try:
            return full.coerce(value, param=param, ctx=ctx)
        except typer.BadParameter as error:
            if error.__cause__ is None:  # Typer's own words
                raise
            what = f"it must be {_expected_value_text(self._annotation, self._info)}, not {_shorten_repr(value)}"
            if get_origin(self._annotation) is Literal:
                near = hint_at_closest_or_all_known_names(str(value), map(str, get_args(self._annotation)))
                what += f" ({near})" if near.endswith("?") else ""
            raise typer.BadParameter(what, ctx=ctx, param=param) from error


VALUE_FOR_TYPER_TO_CONVERT = object()
"""Marks a value that is left to Typer's conversion."""
_DESCRIPTION_BY_VALUE_TYPE = {
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    str: "text",
    list[str]: "a list of texts",
}
"""Type of a value -> its description in an error."""
MAX_SHOWN_VALUE_CHARACTERS = 60
"""Longest part of a value that an error or a sentence shows, in characters; chosen by hand."""


def _expected_value_text(annotation: Any, info: Any) -> str:
    """Describe the values that an option takes."""
    if get_origin(annotation) is Literal:
        return f"one of {', '.join(map(str, get_args(annotation)))}"
    words = _DESCRIPTION_BY_VALUE_TYPE.get(annotation, "another value")
    if info.min is not None and info.max is not None:
        return f"{words} from {info.min:g} to {info.max:g}"
    if info.min is not None:
        return f"{words} of at least {info.min:g}"
    return words if info.max is None else f"{words} of at most {info.max:g}"


def _shorten_repr(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= MAX_SHOWN_VALUE_CHARACTERS else f"{text[: MAX_SHOWN_VALUE_CHARACTERS - 1]}…"


def coerce_plain_value(annotation: Any, value: Any) -> Any:
    if annotation is str and isinstance(value, str):
        return value
    if annotation == list[str] and isinstance(value, (list, tuple)):
        return list(value) if all(isinstance(item, str) for item in value) else VALUE_FOR_TYPER_TO_CONVERT
    if get_origin(annotation) is Literal and value in get_args(annotation):
        return value
    if annotation in (int, float):
        return _coerce_plain_number(annotation, value)
    return VALUE_FOR_TYPER_TO_CONVERT


def _coerce_plain_number(kind: type[int] | type[float], value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        return VALUE_FOR_TYPER_TO_CONVERT
    try:
        result = kind(value)
    except (ValueError, OverflowError):
        return VALUE_FOR_TYPER_TO_CONVERT
    return result if kind is float or str(result) == str(value) else VALUE_FOR_TYPER_TO_CONVERT


def is_non_finite(value: Any) -> bool:
    """Whether a value is a number that is not finite."""
    return isinstance(value, float) and not math.isfinite(value)


def is_within_bounds(value: Any, least: float | None, most: float | None) -> bool:
    """Whether a value is within the bounds of its option; Typer reports one that is not."""
    return (least is None or value >= least) and (most is None or value <= most)


def use_plain_coercion(parameters: list[Any]) -> list[Any]:
    """Give each parameter the plain conversion; returns the parameters.

    A version of Typer without this hook is left unchanged; only the start takes longer.
    """
    for parameter in parameters:
        if getattr(parameter, "_runtime_param", 0) is not None or not hasattr(parameter, "type_descriptor"):
            continue
        info = getattr(parameter.type_descriptor, "parameter_info", None)
        if info is None or info.parser is not None:
            continue
        parameter._runtime_param = _PlainCoercion(parameter)
    return parameters
