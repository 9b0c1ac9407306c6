"""The Typer app: which commands there are, loaded one by one.

`cwcli --help` imports no command; `cwcli info` imports `cwcli.cli.commands.info` only. Help is plain text: typer's
rich help costs 60 ms of import and breaks lines differently on a terminal and in a pipe.
"""

from __future__ import annotations

import os
import re
import sys
from typing import Annotated, Any

import typer
import typer.core
import typer.main

from cwcli.cli.commands import HELP_LINE_BY_COMMAND
from cwcli.cli.load import load_command_function_and_examples
from cwcli.cli.options.complete import run_completion_with_bash_equals_fix
from cwcli.cli.options.configfile import TalkOptions, origins_of_configured_options
from cwcli.cli.options.expand import ENVIRONMENT_PREFIX
from cwcli.cli.options.lazy_typer import use_typer_declarations
from cwcli.cli.options.plain_coercion import MAX_SHOWN_VALUE_CHARACTERS, use_plain_coercion
from cwcli.cli.root_help import NO_PLUGINS_HELP, ROOT_HELP_EPILOG, ROOT_HELP_PARAGRAPH
from cwcli.errors import UsageError
from cwcli.input import remember_inputs
from cwcli.text import shorten_and_escape
from cwcli.version import __version__

MAX_OPTIONS_WITHOUT_HEADINGS = 15
"""Greatest number of options that the help of a command lists without headings. Chosen by hand."""


class PlainCommand(typer.core.TyperCommand):
    """A Typer command that converts plain values without pydantic."""

    def get_params(self, ctx: Any) -> Any:
        """The parameters, `--help` included."""
        return use_plain_coercion(super().get_params(ctx))

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then the options, below the headings of their groups if there are many."""
        arguments: list[tuple[str, str]] = []
        groups: dict[str, list[tuple[str, str]]] = {"Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and parameter.param_type_name == "argument":
                arguments.append(record)
            elif record is not None:
                own = TalkOptions.heading if parameter.name == "help" else "Options"
                heading = getattr(parameter, "rich_help_panel", None) or own
                groups.setdefault(heading, []).append(record)
        if sum(map(len, groups.values())) <= MAX_OPTIONS_WITHOUT_HEADINGS:
            groups = {"Options": [record for records in groups.values() for record in records]}
        for heading, records in {"Arguments": arguments, **groups}.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


class LazyGroup(typer.core.TyperGroup):
    """A Typer group that imports a command only when it is invoked."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name, line in HELP_LINE_BY_COMMAND.items():
            self.commands[name] = typer.core.TyperCommand(name, help=line, rich_markup_mode=None)

    def get_params(self, ctx: Any) -> Any:
        """The parameters, `--help` included."""
        return use_plain_coercion(super().get_params(ctx))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command, with its options; None if there is none of this name."""
        return load_command(cmd_name) if cmd_name in HELP_LINE_BY_COMMAND else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(HELP_LINE_BY_COMMAND.items()))


def load_command(name: str) -> Any:
    """Import one command's module and make its Typer command.

    Raises:
        UsageError: Its module is missing.
    """
    function, examples = load_command_function_and_examples(name)
    single = typer.Typer(add_completion=False, rich_markup_mode=None)
    heading = "Example:" if len(examples) == 1 else "Examples:"
    epilog = "\n".join(["\b", heading, *(f"  {example}" for example in examples)])
    single.command(name, cls=PlainCommand, epilog=epilog)(use_typer_declarations(function))
    return typer.main.get_command(single)


def _print_version(value: bool) -> None:
    if value:
        typer.echo(f"cwcli {__version__}")
        raise typer.Exit


app = typer.Typer(
    cls=LazyGroup,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help=ROOT_HELP_PARAGRAPH,
    epilog=ROOT_HELP_EPILOG,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(help=ROOT_HELP_PARAGRAPH)
def root_command(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    no_plugins: Annotated[bool, typer.Option("--no-plugins", help=NO_PLUGINS_HELP)] = False,
) -> None:
    """Take the options of the whole command line."""


def dispatch_command(arguments: list[str]) -> int:
    """Run the command line and return its exit code.

    Typer's own `main` is used for shell completion only: it would turn a closed pipe into exit code 1.

    Raises:
        CwcliError: Known errors; wrong usage is a `UsageError`.
    """
    group = typer.main.get_command(app)
    if os.environ.get(f"_{ENVIRONMENT_PREFIX}_COMPLETE"):
        run_completion_with_bash_equals_fix(lambda: group.main(arguments, prog_name="cwcli"))
    try:
        with remember_inputs(), group.make_context("cwcli", arguments) as context:
            if not arguments:
                sys.stderr.write(context.get_help() + "\n")
                return UsageError.exit_code
            code = group.invoke(context)
    except typer.Exit as done:
        return done.exit_code
    except typer.TyperException as error:
        raise _usage_error_from_typer(error, arguments) from error
    except UsageError as error:
        raise _add_origin_of_value(error, arguments) from error
    return code if isinstance(code, int) else 0


def _usage_error_from_typer(error: typer.TyperException, arguments: list[str]) -> UsageError:
    context = getattr(error, "ctx", None)
    named = [argument for argument in arguments[:1] if argument in HELP_LINE_BY_COMMAND]
    command = context.command_path if context is not None else " ".join(["cwcli", *named])
    what = " ".join(error.format_message().split()).removesuffix(".")
    variable = _environment_variable_at_fault(error, context)
    if variable is not None:
        reason = " ".join(str(getattr(error, "message", what)).split()).removesuffix(".")
        option = error.param.opts[0]  # type: ignore[attr-defined]
        return UsageError(
            f"the environment variable {variable}="
            f"{shorten_and_escape(os.environ[variable], MAX_SHOWN_VALUE_CHARACTERS)}: {reason}",
            hint=f"see {option} in `{command} --help`",
        )
    if what.startswith("Missing argument") and context is not None:
        names = context.command.collect_usage_pieces(context)[1:]  # behind the options
        if len(names) > 1:  # of several, the parser names the first that is empty, which may not be the one left out
            what = f"an argument is missing: {command} {re.sub('[{}]', '', ' '.join(names))}"
    return UsageError(what[:1].lower() + what[1:], hint=f"see `{command} --help`")


def _add_origin_of_value(error: UsageError, arguments: list[str]) -> UsageError:
    """Add to an error the environment variable or configuration key that set the option it names."""
    names_on_command_line = {argument.partition("=")[0] for argument in arguments}
    command = arguments[0].replace("-", "_") if arguments else ""
    for option in re.findall(r"--[a-z][a-z0-9-]*", error.what):
        name = option[2:].replace("-", "_")
        variables = [f"{ENVIRONMENT_PREFIX}_{each}".upper() for each in (name, f"{command}_{name}")]
        origin = next((f"the environment variable {each}" for each in variables if os.environ.get(each)), None)
        origin = origin or origins_of_configured_options().get(option)
        if origin is not None and option not in names_on_command_line:
            hint = f"{option} comes from {origin}" + (f"; {error.hint}" if error.hint else "")
            return UsageError(error.what, where=error.where, found=error.found, hint=hint)
    return error


def _environment_variable_at_fault(error: typer.TyperException, context: Any) -> str | None:
    """The environment variable that holds the wrong value; None if the value comes from elsewhere."""
    option = getattr(error, "param", None)
    if context is None or option is None:
        return None
    source = context.get_parameter_source(option.name)
    variable = getattr(option, "envvar", None)
    is_from_there = source is not None and source.name == "ENVIRONMENT"
    return variable if is_from_there and isinstance(variable, str) and variable in os.environ else None
