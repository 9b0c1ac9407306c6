"""`cwcli config`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any

from cwcli.cli.console import Console
from cwcli.cli.options import lazy_typer as typer
from cwcli.cli.options.expand import expand_dataclass_parameters
from cwcli.cli.options.stage import make_all_stage_options_classes
from cwcli.errors import UsageError

EXAMPLES = ("cwcli config", "cwcli config > pipeline.toml")
"""Command lines at the end of the command's `--help`."""


def command(
    file: Annotated[
        str | None, typer.Argument(metavar="FILE", help="Pipeline file; without one, the defaults are printed.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON instead of TOML.")] = False,
) -> None:
    """Print a pipeline file with every option resolved and checked.

    What is printed is itself a pipeline file for `cwcli run --config` that means the same: values of the environment
    and defaults are in it too. An option without a value stands in a comment.
    """
    document = resolve_all_options(file)
    Console().print_data(json.dumps(document, indent=2, allow_nan=False) if as_json else format_toml(document).rstrip())


def resolve_all_options(file: str | None) -> dict[str, Any]:
    """Resolve all options of `cwcli run` that change its results, from the file, the environment and the defaults.

    Returns:
        The options as a document.

    Raises:
        UsageError: The file can't be read, or holds an unknown key or a value that does not fit.
    """
    from cwcli.cli.app import load_command
    from cwcli.cli.commands.run import gather_all_options
    from cwcli.pipeline.selection import check_selection_options

    arguments = ["LOG", *(() if file is None else ("--config", file))]
    with load_command("run").make_context("run", arguments) as context:
        values = dict(context.params)
    try:
        options = expand_dataclass_parameters(gather_all_options, "run", stages=make_all_stage_options_classes())(
            **values
        )
        check_selection_options(options.inputs.topics_and_mappings, options.inputs.start, options.inputs.end)
        document: dict[str, Any] = options.to_document()
    except UsageError as error:
        raise UsageError(error.what, where=error.where or file or "", found=error.found, hint=error.hint) from error
    return document


def format_toml(document: Mapping[str, Any]) -> str:
    """Format a document of values, lists and tables as TOML; None becomes a comment."""
    lines = [_key_value_line(key, value) for key, value in document.items() if not isinstance(value, Mapping)]
    for name, table in document.items():
        if isinstance(table, Mapping):
            lines += ["", f"[{name}]", *(_key_value_line(key, value) for key, value in table.items())]
    return "\n".join(lines) + "\n"


def _key_value_line(key: str, value: Any) -> str:
    return f"# {key} =" if value is None else f"{key} = {_format_value(value)}"


def _format_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_format_value, value))}]"
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
