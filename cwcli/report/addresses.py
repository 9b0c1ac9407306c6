"""Where a run's warnings and conflicts stand in its page: links for what other commands write."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from cwcli.errors import CwcliError, UsageError
from cwcli.logs.read.reader import Log
from cwcli.metrics.gates import Check
from cwcli.report.drive import read_drive
from cwcli.report.encounters import find_meetings
from cwcli.report.pairs import link_texts, warning_marks
from cwcli.report.source import Entry, read_run
from cwcli.report.story import name_of, verdict_badge
from cwcli.report.tables import MAX_ROWS

MAX_LINKS = 20
"""Of one check."""
MAX_LOGS = 20
"""That are read for links; each takes about as long as it takes to judge its warnings."""
KEPT = "/:?=&%~.-_+@,;"
"""What stands in an address as it is; the rest, brackets and spaces among it, is escaped."""
ABOUT = "warnings."
"""What the names of metrics of warnings and conflicts begin with."""


@dataclass(frozen=True)
class Link:
    """A warning or a conflict: in words, and its address in the page."""

    words: str
    address: str


class Addresses:
    """Links into the page that `cwcli report` makes of a run."""

    def __init__(self, source: str, page: str) -> None:
        """Look for the logs.

        Args:
            source: Output folder of `cwcli run -d`, or one annotated log.
            page: Address of the page, as a reader of the links will find it.

        Raises:
            UsageError: The source is one that can't be read a second time, or the address is empty.
            InputError: The source is no run.
        """
        if not page.strip():
            raise UsageError("--report-at names no page", hint="give its address, e.g. --report-at report.html")
        if source == "-" or Path(source).suffix.lower() == ".parquet":
            raise UsageError("--report-at needs the annotated logs as files, to find their warnings in", where=source)
        self._source = source
        self._run = read_run(source)
        self._page = quote(page.strip(), safe=KEPT)
        self._known: dict[str, list[Link]] = {}

    def of_check(self, gate: str, check: Check) -> list[Link]:
        """The warnings and conflicts that a gate on warnings asked about: those of its log, or of all logs."""
        if ABOUT not in gate and ABOUT not in check.detail:
            return []
        is_any = not check.log or not self._run.is_folder
        entries = [entry for entry in self._run.entries if is_any or entry.id == check.log]
        found: list[Link] = []
        for entry in entries[:MAX_LOGS]:
            found += self._of_log(entry)
            if len(found) >= MAX_LINKS:
                break
        return found[:MAX_LINKS]

    def _of_log(self, entry: Entry) -> list[Link]:
        if entry.id not in self._known:
            is_unread = entry.log is None or entry.has_failed or len(self._known) >= MAX_LOGS
            self._known[entry.id] = [] if is_unread else self._read(entry)
        return self._known[entry.id]

    def _read(self, entry: Entry) -> list[Link]:
        source = str(entry.log) if self._run.is_folder else self._source
        try:
            with Log.open(source) as log:
                name = entry.name if self._run.is_folder else log.name.rpartition("/")[2]
                marked = _marked(log, name)
        except CwcliError:  # the check has failed for it already
            return []
        whose = f"{entry.id}: " if len(self._run.entries) > 1 else ""
        return [Link(f"{whose}{words}", f"{self._page}#{mark}") for mark, words in marked]


def _marked(log: Log, name: str) -> list[tuple[str, str]]:
    """Name and words of what has an anchor in the page: what went wrong first, then the warnings that came true."""
    meetings = find_meetings(read_drive(log))
    right: list[tuple[str, str]] = []
    wrong: list[tuple[str, str]] = []
    named = zip(warning_marks(name, meetings), meetings.encounters, strict=True)
    for mark, encounter in list(named)[:MAX_ROWS]:
        badge = verdict_badge(encounter)
        told = right if badge.tone == "alert" else wrong
        told.append((mark, f"warning {encounter.event_id}, {name_of(encounter)}: {badge.text}"))
    missed = [(mark, f"{words}: not warned of") for mark, words in link_texts(meetings, name)]
    return [*wrong, *missed, *right]
