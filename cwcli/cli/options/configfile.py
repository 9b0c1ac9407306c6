"""The configuration file: TOML, defaults for the options, below flags and environment.

    topic = ["ego_position=/gps/fix"]
    strict = true

    [estimate]
    model = "song2016"

Keys at the top are options that commands share; a command takes those that it has. A table holds the options of one
command, and `cwcli run` reads the tables of its stages. A name that no command knows is an error.

Without the option, `cwcli.toml` of the working folder, or of the nearest folder above it that has one, is such a file.

A configuration file can name no output files and can't allow overwriting, because it may come from somebody else.
"""

from __future__ import annotations

from contextvars import ContextVar
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.shared import ReadingOptions, SensorOptions, WritingOptions
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass

DEFAULT_CONFIG_NAME = "cwcli.toml"
"""Name of the file that is used when no file is named."""
NO_CONFIG_FILE_VALUE = "none"
"""Value of `--config` that disables configuration files."""
STAGE_SEPARATOR = "__"
"""Separator of stage and option in parameter names of a command that runs several stages; no name contains it."""

_ORIGIN_BY_OPTION: ContextVar[dict[str, str]] = ContextVar("origins", default={})  # noqa: B039 - never changed in place
"""Option -> key and file of its value, in the configuration of this run."""

WRITING_PARAMETERS = frozenset(
    {
        *("output", "force", "metrics", "metrics_dir", "directory", "junit", "markdown_file", "comment", "plots"),
        *("report", "clips", "html"),
    }
)
"""Parameters that name output files or allow overwriting; a configuration file may not set them."""


def apply_config_file(ctx: typer.Context, value: str | None) -> str | None:
    """Take the file's values as the command's defaults (Typer callback of `--config`).

    Raises:
        UsageError: The file can't be read, is no TOML, or holds an unknown or unfit key, or one that writes.
    """
    if ctx.resilient_parsing or value == NO_CONFIG_FILE_VALUE:
        return None
    is_found = value is None
    value = value or find_config_file()
    if value is None:
        return None
    document = _load_toml(value)
    options = {parameter.name: parameter for parameter in ctx.command.params if parameter.name is not None}
    defaults: dict[str, Any] = {}
    origins: dict[str, str] = {}
    for key, entry in _shared_options_of_document(value, document).items():
        if key in options:
            defaults[key] = _check_entry(ctx, value, key, entry, options[key])
            origins[options[key].opts[0]] = f"{key} in {value}"
    command = str(ctx.info_name)
    for table, entries in document.items():
        if not isinstance(entries, dict):
            continue
        prefix = "" if table == command else f"{_parameter_name(table)}{STAGE_SEPARATOR}"
        own = [name for name in options if name.startswith(prefix) and (prefix or STAGE_SEPARATOR not in name)]
        for key, entry in entries.items() if own else ():
            _check_key_names_no_output(value, key)
            option = f"{prefix}{_parameter_name(key)}"
            if option not in own:
                known = sorted(name.removeprefix(prefix) for name in own)
                raise _unknown_key_error(value, f"{table}.{key}", known)
            defaults[option] = _check_entry(ctx, value, f"{table}.{key}", entry, options[option])
            origins[options[option].opts[0]] = f"{table}.{key} in {value}"
    _check_topic_and_time_syntax(value, defaults)
    if is_found and defaults:
        from cwcli.cli.console import Console

        Console(quiet=bool(ctx.params.get("quiet"))).print_note(
            f"defaults from {value} (--config {NO_CONFIG_FILE_VALUE} does without)"
        )
    ctx.default_map = defaults
    _ORIGIN_BY_OPTION.set(origins)
    return value


def origins_of_configured_options() -> dict[str, str]:
    """Option -> key and file of its value, for the options that the configuration file has set."""
    return _ORIGIN_BY_OPTION.get()


def find_config_file() -> str | None:
    """Find the nearest `cwcli.toml`; None also if the working folder is deleted or a folder can't be searched."""
    try:
        folder = Path.cwd()
        if (folder / DEFAULT_CONFIG_NAME).is_file():
            return DEFAULT_CONFIG_NAME
        return next(
            (str(above / DEFAULT_CONFIG_NAME) for above in folder.parents if (above / DEFAULT_CONFIG_NAME).is_file()),
            None,
        )
    except OSError:
        return None


def _load_toml(path: str) -> dict[str, Any]:
    from cwcli.input import read_file
    from cwcli.toml_text import parse_toml

    try:
        return parse_toml(read_file(path).decode())
    except OSError as error:
        raise UsageError(f"can't read the configuration: {error.strerror}", where=path) from error
    except ValueError as error:  # TOMLDecodeError and UnicodeDecodeError are ValueErrors
        raise UsageError(f"the configuration is not TOML: {error}", where=path) from error


def _shared_options_of_document(path: str, document: dict[str, Any]) -> dict[str, Any]:
    """The shared options of the document, by parameter name."""
    from cwcli.cli.commands import HELP_LINE_BY_COMMAND

    shared = shared_option_names()
    found = {}
    for key, entry in document.items():
        if isinstance(entry, dict):
            if key not in HELP_LINE_BY_COMMAND:
                raise _unknown_key_error(path, f"[{key}]", list(HELP_LINE_BY_COMMAND))
            continue
        _check_key_names_no_output(path, key)
        if _parameter_name(key) in shared:
            found[_parameter_name(key)] = entry
        else:
            raise _unknown_key_error(path, key, sorted(shared))
    return found


def shared_option_names() -> set[str]:
    """Names of the options that commands share."""
    kinds = (ReadingOptions, SensorOptions, WritingOptions, RunTalkOptions)
    names = {field.name for kind in kinds for field in fields(kind)}
    return (names | {"gates"}) - {"config"} - WRITING_PARAMETERS


def _check_key_names_no_output(path: str, key: str) -> None:
    if _parameter_name(key) in WRITING_PARAMETERS:
        what = f"{key} is for the command line: a configuration neither names files to write nor overwrites any"
        raise UsageError(what, where=path, hint="leave it out here, and give it there")


def _check_topic_and_time_syntax(path: str, defaults: dict[str, Any]) -> None:
    """Check the syntax of topic choices and times, without a log."""
    named = {key: defaults[key] for key in ("topic", "map", "start", "end") if key in defaults}
    if not named:
        return
    from cwcli.pipeline.selection import check_selection_options
    from cwcli.signals.mapping import merge_mapping_options

    try:
        topics = [*named.get("topic", ()), *merge_mapping_options(named.get("map", ()), (), "map =")]
        check_selection_options(topics, named.get("start"), named.get("end"), spelled="{} =")
    except UsageError as error:
        raise UsageError(error.what, where=path, hint=error.hint) from error


def _parameter_name(key: str) -> str:
    return key.replace("-", "_")


def _unknown_key_error(path: str, key: str, known: list[str]) -> UsageError:
    from cwcli.cli.console import closest_names_hint

    return UsageError(
        f"unknown key {key} in the configuration", where=path, hint=closest_names_hint(key.rpartition(".")[2], known)
    )


def _check_entry(ctx: typer.Context, path: str, key: str, entry: Any, option: Any) -> Any:
    """Check that type and value of an entry fit its option; returns the value.

    Raises:
        UsageError: They do not.
    """
    takes_list = bool(getattr(option, "multiple", False))
    is_flag = bool(getattr(option, "is_flag", False))
    items = entry if isinstance(entry, list) else [entry]
    if isinstance(entry, list) != takes_list:
        raise UsageError(f"{key} must {'' if takes_list else 'not '}be a list", where=path)
    if any(isinstance(item, bool) != is_flag for item in items):
        raise UsageError(f"{key} must {'' if is_flag else 'not '}be true or false", where=path)
    if any(isinstance(item, (dict, list)) for item in items):
        raise UsageError(f"{key} must be {'a list of values' if takes_list else 'a value'}", where=path)
    if is_flag:
        return entry
    text = [str(item) for item in items]
    value = text if takes_list else text[0]
    try:
        option.get_runtime_param().coerce(value, param=option, ctx=ctx)
    except typer.TyperException as error:
        reason = getattr(error, "message", "") or error.format_message()
        hint = f"see {option.opts[0]} in `cwcli {ctx.info_name} --help`"
        raise UsageError(
            f"{key} = {value!r}: {reason.removesuffix('.').removeprefix('Value error, ')}", where=path, hint=hint
        ) from error
    return value


@dataclass(frozen=True)
class TalkOptions:
    """What is printed, and where further settings come from."""

    heading: ClassVar[str] = "General"
    json: Annotated[
        bool, typer.Option("--json", help="Print the summary as JSON on standard output instead of tables.")
    ] = False
    quiet: Annotated[bool, typer.Option("--quiet", "-q", is_eager=True, help="Print errors only.")] = False
    config: Annotated[
        str | None,
        typer.Option(
            "--config",
            metavar="FILE",
            is_eager=True,
            callback=apply_config_file,
            help="TOML file with defaults for these options; none: ignore a cwcli.toml in this folder or above.",
        ),
    ] = None


@dataclass(frozen=True)
class RunTalkOptions(TalkOptions):
    """What is printed by a command that runs stages."""

    details: Annotated[
        bool, typer.Option("--details", help="Print every table and note of the stages below the digest.")
    ] = False
