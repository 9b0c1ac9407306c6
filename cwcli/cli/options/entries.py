"""Lists the options in a stage's annotated configuration (`cwcli.option`) with the fields that hold their values."""

from __future__ import annotations

import dataclasses
import functools
import keyword
import typing
from collections.abc import Iterator
from typing import Any

from cwcli.lazy_dataclass import dataclass
from cwcli.option import Option
from cwcli.stages import STAGES


@dataclass(frozen=True)
class OptionEntry:
    """An option of a stage and the field of the configuration that holds its value.

    Attributes:
        key: Name of the option in a configuration file.
        path: Names of the nested fields that lead to the value.
        option: The annotated option.
        kind: Type of its value.
        default: Default value.
    """

    key: str
    path: tuple[str, ...]
    option: Option
    kind: Any
    default: Any


@functools.cache
def option_entries_of_stage(name: str) -> tuple[OptionEntry, ...]:
    """List the options of a stage.

    Raises:
        UsageError: The stage's module is missing.
    """
    return tuple(_iter_option_entries(STAGES[name].configuration_class(), ()))


def _iter_option_entries(default: Any, path: tuple[str, ...]) -> Iterator[OptionEntry]:
    hints = typing.get_type_hints(type(default), include_extras=True)
    for field in dataclasses.fields(default):
        value, place = getattr(default, field.name), (*path, field.name)
        kind, *extras = typing.get_args(hints[field.name]) or (hints[field.name],)
        option = next((extra for extra in extras if isinstance(extra, Option)), None)
        if option is not None:
            kind = option.kind or kind
            given = _empty_value(kind) if option.parse else value
            yield OptionEntry(config_key_of_flags(option.flags), place, option, kind, given)
        elif dataclasses.is_dataclass(value):
            yield from _iter_option_entries(value, place)


def _empty_value(kind: Any) -> Any:
    """Default of an option whose text is parsed: an empty list, False or None."""
    return [] if typing.get_origin(kind) is list else False if kind is bool else None


def config_key_of_flags(flags: str) -> str:
    """Name of an option in a configuration file: `tune` of `--tune/--no-tune`; `as_` of `--as`, a word of Python."""
    name = flags.partition("/")[0].removeprefix("--").replace("-", "_")
    return f"{name}_" if keyword.iskeyword(name) else name
