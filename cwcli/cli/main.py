"""The entry point: runs the command line and turns whatever happens into one of `cwcli.errors.EXIT_CODES`."""

from __future__ import annotations

import contextlib
import errno
import gc
import os
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from cwcli.cli.invocation import remember_arguments
from cwcli.errors import (
    EXIT_BUG,
    EXIT_INTERRUPTED,
    EXIT_NOT_WRITTEN,
    EXIT_PIPE_CLOSED,
    CwcliError,
    OutputError,
    Terminated,
)

_NO_PLUGINS_OPTION = "--no-plugins"
"""Option, in front of the command, that leaves out what other packages add."""
NEW_OBJECTS_PER_GARBAGE_COLLECTION = 50_000
"""Number of new objects after which Python looks for cycles among them. Chosen by hand: with Python's own 700 the looks
take a twentieth of a command, and cycles are few."""
DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Error numbers of a write that found no space."""


def main() -> NoReturn:
    """Run `cwcli` with the process's arguments and leave with its exit code."""
    signal.signal(signal.SIGTERM, _raise_terminated)
    # NumPy's matrix library otherwise starts a thread per core that spins for 0.1 s, for matrices as small as ours
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(NEW_OBJECTS_PER_GARBAGE_COLLECTION, *gc.get_threshold()[1:])
    try:
        code = run_command_line(sys.argv[1:])
    except KeyboardInterrupt:  # it came while the last lines were printed
        code = EXIT_INTERRUPTED
    # the exit code is settled: a later Ctrl-C could only print a traceback while Python ends
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)


def run_command_line(arguments: Sequence[str]) -> int:
    """Run `cwcli` with arguments, print its output and errors, and return the exit code; raises only `SystemExit`."""
    remember_arguments(arguments)
    try:
        _make_streams_robust()
        code = (
            _dispatch_without_plugins(list(arguments))
            if _NO_PLUGINS_OPTION in arguments[:1]
            else _dispatch(list(arguments))
        )
        _flush_stdout()
    except CwcliError as error:
        code = error.exit_code
        _print_known_error(_redact_error(error, arguments))
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
        _print_to_stderr("interrupted")
    except BrokenPipeError:
        code = EXIT_PIPE_CLOSED
    except SystemExit:
        raise
    except BaseException as error:  # one that is no Exception would end Python with 1, the code of a failed gate
        signalled = _signal_error_that_caused(error)
        if isinstance(signalled, Terminated):
            raise signalled from None
        code = EXIT_INTERRUPTED if signalled else _print_unexpected_error_and_exit_code(error, arguments)
    try:
        _flush_stdout()
    except BrokenPipeError:
        _discard_stdout()
        code = code or EXIT_PIPE_CLOSED
    except CwcliError as error:
        _discard_stdout()
        if not code:
            code = error.exit_code
            _print_known_error(error)
    return code


def _signal_error_that_caused(error: BaseException) -> BaseException | None:
    """Return the error of a signal behind an error; None if there is none: Python itself turns one into another error
    where it comes while a class is made (`__set_name__`)."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, Terminated | KeyboardInterrupt):
        cause = cause.__cause__ or cause.__context__
    return cause


def _dispatch_without_plugins(arguments: list[str]) -> int:
    """Run the command line without what other packages add, in this process and those that it starts."""
    from cwcli.registry import NO_PLUGINS_VARIABLE

    before = os.environ.get(NO_PLUGINS_VARIABLE)
    os.environ[NO_PLUGINS_VARIABLE] = "1"
    try:
        return _dispatch(arguments[1:])
    finally:
        if before is None:
            del os.environ[NO_PLUGINS_VARIABLE]


def _dispatch(arguments: list[str]) -> int:
    """Run the command line: plain arguments without Typer, which takes half of the start of a short command."""
    if arguments in (["--help"], ["-h"]) and "_CWCLI_COMPLETE" not in os.environ:
        from cwcli.cli.root_help import format_root_help

        text = format_root_help()
        if text is not None and sys.stdout is not None:
            sys.stdout.write(text)
            return 0
    from cwcli.cli.plain_arguments import run_plain_command

    code = run_plain_command(arguments)
    if code is not None:
        return code
    from cwcli.cli.app import dispatch_command

    return dispatch_command(arguments)


def _raise_terminated(number: int, frame: object) -> NoReturn:
    """Handle a signal by raising `Terminated`, so that `finally` blocks remove temporary files."""
    raise Terminated


def _make_streams_robust() -> None:
    """Let stdout and stderr escape characters that their encoding lacks, instead of raising."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")


def _flush_stdout() -> None:
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _output_error_from(error) from error


def _output_error_from(error: OSError) -> OutputError:
    return OutputError(f"can't write the output: {error.strerror}", where=str(error.filename or ""))


def _discard_stdout() -> None:
    """Redirect stdout to the null device, so that the interpreter's flush at exit raises no error."""
    with contextlib.suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _print_known_error(error: CwcliError) -> None:
    from cwcli.cli.console import print_error

    print_error(error)


def _print_to_stderr(text: str) -> None:
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr)


def _print_unexpected_error_and_exit_code(error: BaseException, arguments: Sequence[str]) -> int:
    if isinstance(error, OSError) and error.errno in DISK_FULL_ERRNOS:  # on the way to standard output
        _print_known_error(_output_error_from(error))
        return EXIT_NOT_WRITTEN
    _print_bug_report(arguments)
    return EXIT_BUG


def _print_bug_report(arguments: Sequence[str]) -> None:
    import traceback

    from cwcli.cli.text import shorten_and_escape
    from cwcli.version import __version__

    kind, value = sys.exc_info()[:2]
    trace = _redact_secrets(traceback.format_exc(), arguments)
    _print_to_stderr("\n".join(shorten_and_escape(line) for line in trace.splitlines()))
    what = shorten_and_escape(_redact_secrets(str(value), arguments), 200)
    _print_to_stderr(f"error: a bug in cwcli {__version__}: {kind.__name__ if kind else ''}: {what}")
    _print_to_stderr("  hint:  please report it with the lines above and your command (README.md, section Bugs)")


def _redact_error(error: CwcliError, arguments: Sequence[str]) -> CwcliError:
    """Remove from an error the secrets of URLs on the command line, also where only a part of a URL is repeated."""
    if not any("://" in argument for argument in arguments):
        return error
    safe = CwcliError(
        _redact_secrets(error.what, arguments),
        where=_redact_secrets(error.where, arguments),
        found=tuple(_redact_secrets(entry, arguments) for entry in error.found),
        hint=_redact_secrets(error.hint, arguments),
    )
    safe.exit_code = error.exit_code
    return safe


def _redact_secrets(text: str, arguments: Sequence[str]) -> str:
    """Remove from a text the secrets of all URLs, and those of the URLs on the command line."""
    from cwcli.url import redact_urls

    for argument in arguments:
        text = redact_urls(text, argument)
    return redact_urls(text)
