"""Runs a command whose arguments are plain, without Typer.

Plain are named options with their values, flags and logs. All else is left to Typer (`cwcli.cli.app`): help,
completion, variables `CWCLI_*`, a configuration file, an option that is given twice, and every mistake.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Sequence
from typing import Any, get_args

from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.cli.options.configfile import find_config_file
from cwcli.cli.options.expand import ENVIRONMENT_PREFIX
from cwcli.cli.options.lazy_typer import find_declaration_in_type_hint
from cwcli.cli.options.plain_coercion import (
    VALUE_FOR_TYPER_TO_CONVERT,
    coerce_plain_value,
    is_non_finite,
    is_within_bounds,
)


def run_plain_command(arguments: Sequence[str]) -> int | None:
    """Run a command if its arguments are plain; returns its exit code, or None where Typer has to read them.

    Raises:
        CwcliError: Known errors.
    """
    if not arguments or arguments[0] not in HELP_LINE_BY_COMMAND or not _is_plain_surroundings():
        return None
    from cwcli.cli.load import load_command_function_and_examples
    from cwcli.input import remember_inputs

    function, _ = load_command_function_and_examples(arguments[0])
    values = parse_plain_arguments(function, arguments[1:])
    if values is None:
        return None
    with remember_inputs():
        code = function(**values)
    return code if isinstance(code, int) else 0


def _is_plain_surroundings() -> bool:
    """Whether neither the environment nor a configuration file sets an option."""
    names = (f"{ENVIRONMENT_PREFIX}_", f"_{ENVIRONMENT_PREFIX}_")
    return not any(name.startswith(names) for name in os.environ) and find_config_file() is None


def parse_plain_arguments(function: Callable[..., Any], arguments: Sequence[str]) -> dict[str, Any] | None:
    """The value of each parameter of a command's function; None where Typer has to read them.

    Args:
        function: With a keyword for each option and argument, as `cwcli.cli.load` makes it.
    """
    parameters = inspect.signature(function).parameters
    by_flag: dict[str, tuple[str, bool]] = {}
    positional: list[str] = []
    for name, parameter in parameters.items():
        declaration = find_declaration_in_type_hint(parameter.annotation)
        if declaration is None:
            return None
        if declaration.kind == "Argument":
            positional.append(name)
            continue
        for flags in declaration.flags:
            on, _, off = flags.partition("/")
            by_flag |= {on: (name, True)} | ({off: (name, False)} if off else {})
    given = _split_options_and_words_or_none(parameters, by_flag, arguments)
    if given is None or len(positional) != 1:
        return None
    texts, words = given
    if words:
        is_list = get_args(parameters[positional[0]].annotation)[0] == list[str]
        if not is_list and len(words) > 1:
            return None
        texts[positional[0]] = words if is_list else words[0]
    values = {
        name: _value_or_not_plain(parameter, texts.get(name, parameter.default))
        for name, parameter in parameters.items()
    }
    return None if any(value is VALUE_FOR_TYPER_TO_CONVERT for value in values.values()) else values


def _split_options_and_words_or_none(
    parameters: Any, by_flag: dict[str, tuple[str, bool]], arguments: Sequence[str]
) -> tuple[dict[str, Any], list[str]] | None:
    """What is given by parameter, and the words that belong to no option; None if they are not plain."""
    texts: dict[str, Any] = {}
    words: list[str] = []
    waiting = iter(arguments)
    for argument in waiting:
        if not argument.startswith("-") or argument == "-":
            words.append(argument)
            continue
        flag, sign, value = argument.partition("=")
        if flag not in by_flag or (sign and not flag.startswith("--")):
            return None
        name, is_on = by_flag[flag]
        kind = get_args(parameters[name].annotation)[0]
        if kind is bool:
            if sign or name in texts:
                return None
            texts[name] = is_on
            continue
        text = value if sign else next(waiting, None)
        if text is None or (text.startswith("-") and text != "-"):
            return None
        if kind == list[str]:
            texts.setdefault(name, []).append(text)
        elif name in texts:
            return None
        else:
            texts[name] = text
    return texts, words


def _value_or_not_plain(parameter: inspect.Parameter, given: Any) -> Any:
    """The value of a parameter; `VALUE_FOR_TYPER_TO_CONVERT` where Typer has to find it, or to say what is wrong."""
    declaration = find_declaration_in_type_hint(parameter.annotation)
    kind = get_args(parameter.annotation)[0]
    if given is parameter.empty or declaration is None:
        return VALUE_FOR_TYPER_TO_CONVERT
    if given is not None and declaration.settings_or_empty_if_deferred.get("callback"):  # `--config` reads a file
        return VALUE_FOR_TYPER_TO_CONVERT
    if given is None:
        return () if list[str] in get_args(kind) else None  # as Typer has it
    if kind is bool and isinstance(given, bool):
        return given
    several = [each for each in get_args(kind) if each is not type(None)]
    if type(None) in get_args(kind) and len(several) == 1:
        kind = several[0]
    value = coerce_plain_value(kind, given)
    limits = declaration.settings_or_empty_if_deferred
    if (
        value is VALUE_FOR_TYPER_TO_CONVERT
        or is_non_finite(value)
        or not is_within_bounds(value, limits.get("min"), limits.get("max"))
    ):
        return VALUE_FOR_TYPER_TO_CONVERT
    return value
