"""Known errors: one line for the user, one documented exit code.

Every error that a user can cause, and every fault of a file, is a `CwcliError`. Anything else that escapes is a bug and
leaves with exit code 70 and a traceback (see `cwcli.cli.main`).
"""

from __future__ import annotations

from collections.abc import Iterable

from cwcli.url import redact_urls

PIP_DISTRIBUTION_NAME = "cwcli-drive"
"""Name of the package for pip, as in `pyproject.toml`. `cwcli` on the Python package index is a stranger's package (for
the ConnectWise API), so no text tells anybody to install that."""

EXIT_DONE = 0
"""Exit code of a run that did what was asked."""
EXIT_GATE_FAILED = 1
"""Exit code of a run in which a requested gate failed."""
EXIT_USAGE = 2
"""Exit code for a wrong option or configuration, or a plug-in that fails."""
EXIT_BAD_INPUT = 3
"""Exit code for an input that can't be read or is damaged."""
EXIT_MISSING_SIGNAL = 4
"""Exit code for a log that lacks a required signal, or has several candidates for it."""
EXIT_BAD_DATA = 5
"""Exit code for data that breaks its contract."""
EXIT_NOT_WRITTEN = 6
"""Exit code for an output that could not be written."""
EXIT_BUG = 70
"""Exit code for a bug in cwcli: EX_SOFTWARE of sysexits.h."""
EXIT_INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 and the number of SIGINT, as shells have it."""
EXIT_PIPE_CLOSED = 141
"""Exit code when the reader of a pipe has gone away: 128 and the number of SIGPIPE."""
EXIT_TERMINATED = 143
"""Exit code when the system ends the process: 128 and the number of SIGTERM."""

EXIT_CODES = {
    EXIT_DONE: ("done", ""),
    EXIT_GATE_FAILED: ("a requested gate failed", "everything else was done"),
    EXIT_USAGE: ("usage", "a wrong option, configuration or scenario, or a plug-in that fails"),
    EXIT_BAD_INPUT: ("unreadable or corrupt input", ""),
    EXIT_MISSING_SIGNAL: ("a required signal is missing", "or two channels could be it"),
    EXIT_BAD_DATA: ("data breaks its contract", "with `--strict`, or where no repair is possible"),
    EXIT_NOT_WRITTEN: ("output could not be written", ""),
    EXIT_BUG: ("a bug", "with a traceback"),
    EXIT_INTERRUPTED: ("interrupted", ""),
    EXIT_PIPE_CLOSED: ("pipe closed", "its reader went away"),
    EXIT_TERMINATED: ("terminated", ""),
}
"""Exit code -> its meaning, and a further remark or ""; help and docs are generated from this."""


MAX_LIKENESS_GAP_TO_NEAREST_NAME = 0.1
"""Greatest difference in likeness (`SequenceMatcher.ratio`, 0 to 1) from the most similar name at which a name is
suggested, too. Chosen by hand."""
MIN_CHARS_OF_NAME_SOUGHT_IN_LONGER_NAMES, MAX_SUGGESTED_NAMES_CONTAINING_GIVEN_NAME = 3, 3
"""A name with as many characters, which at most so many names hold, suggests these. Chosen by hand."""


def install_hint(extra: str) -> str:
    """The command that installs the packages of an extra, for `CwcliError.hint`."""
    return f"pip install '{PIP_DISTRIBUTION_NAME}[{extra}]'"


class CwcliError(Exception):
    """An error with a user-facing line. No secret of a URL stands in it, whoever wrote its words.

    Args:
        what: The problem in one line, without a trailing full stop.
        where: File, topic or time that it concerns (`drive.mcap`, `drive.mcap: /gps/fix at 12.3 s`), or "".
        found: The things that were found instead, one entry a line, or ().
        hint: Advice on the next step, or "".
    """

    exit_code = EXIT_BUG

    def __init__(self, what: str, *, where: str = "", found: tuple[str, ...] = (), hint: str = "") -> None:
        what, where = redact_urls(what), redact_urls(where)
        super().__init__(f"{where}: {what}" if where else what)
        self.what = what
        self.where = where
        self.found = tuple(redact_urls(entry) for entry in found)
        self.hint = redact_urls(hint)


class Terminated(SystemExit):
    """The system asked the process to end (SIGTERM); the `finally` blocks run, and nothing may take it for an error."""

    def __init__(self) -> None:
        super().__init__(EXIT_TERMINATED)


class UsageError(CwcliError):
    """The command line or a configuration file is wrong."""

    exit_code = EXIT_USAGE


class PluginError(CwcliError):
    """A plug-in of another package can't be used."""

    exit_code = EXIT_USAGE


class InputError(CwcliError):
    """The input can't be read, or is damaged."""

    exit_code = EXIT_BAD_INPUT


class MissingSignalError(CwcliError):
    """The log lacks a signal that the command needs, or holds more than one candidate for it."""

    exit_code = EXIT_MISSING_SIGNAL


class DataError(CwcliError):
    """The data breaks its contract (units, ranges, order) and `--strict` or the need for it forbids a repair."""

    exit_code = EXIT_BAD_DATA


class OutputError(CwcliError):
    """The output can't be written."""

    exit_code = EXIT_NOT_WRITTEN


def hint_at_closest_or_all_known_names(name: str, known: Iterable[str], label: str = "one of") -> str:
    """Return a hint for a name that is not in a list: the closest names, or the few that hold it, else all of them.

    Args:
        label: Words in front of the list of all names.
    """
    from difflib import SequenceMatcher, get_close_matches

    names = list(known)
    near = get_close_matches(name, names, n=2)
    shares = [SequenceMatcher(None, name, each).ratio() for each in near]
    near = [
        each for each, share in zip(near, shares, strict=True) if share >= shares[0] - MAX_LIKENESS_GAP_TO_NEAREST_NAME
    ]
    holding = (
        [each for each in names if name.lower() in each.lower()]
        if len(name) >= MIN_CHARS_OF_NAME_SOUGHT_IN_LONGER_NAMES
        else []
    )
    near = near or (holding if len(holding) <= MAX_SUGGESTED_NAMES_CONTAINING_GIVEN_NAME else [])
    return f"did you mean {' or '.join(near)}?" if near else f"{label}: {', '.join(names)}"
