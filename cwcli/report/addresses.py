"""Links from what other commands write to a run's warnings and conflicts in its page."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from cwcli.digest.drive import read_drive
from cwcli.digest.encounters import find_encounters
from cwcli.digest.story import badge_of_warning_verdict, name_of_other
from cwcli.errors import CwcliError, UsageError
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.read.reader import Log
from cwcli.metrics.gates import GateCheck
from cwcli.report.pairs import unwarned_conflict_links, warning_anchor_names
from cwcli.report.source import LogEntry, read_reported_run
from cwcli.report.tables import MAX_PAGE_TABLE_ROWS

MAX_LINKS_PER_CHECK = 20
"""The greatest number of links that are given for one check. Chosen by hand; not fitted."""
MAX_LOGS_READ_FOR_LINKS = 20
"""The greatest number of logs that are read for links, as judging the warnings of each takes time.
Chosen by hand; not fitted."""
UNESCAPED_URL_CHARACTERS = "/:?=&%~.-_+@,;"
"""Characters that stay as they are in an address; all others, such as brackets and spaces, are escaped."""
WARNING_METRIC_PREFIX = "warnings."
"""The beginning of the names of all metrics of warnings and conflicts."""


@dataclass(frozen=True)
class PageLink:
    """A link to a warning or a conflict: its description and its address in the page."""

    words: str
    address: str


@dataclass(frozen=True)
class WarningDifference:
    """A warning or conflict that two runs do not have alike.

    Attributes:
        change: `new`, `gone`, or `other`: with another verdict.
        words: What it is, with its log where there are several.
        address: In the page of the later run; "" where it is gone.
    """

    change: str
    words: str
    address: str


@dataclass(frozen=True)
class WarningDifferences:
    """The warnings and conflicts by which two runs differ.

    Attributes:
        listed: At most MAX_LINKS, what is new first.
        n_logs: How many logs of both runs were compared.
        unread: Ids of those that could not be: one of the runs has failed on them, or its annotated log can't be read.
        n_left_out: How many logs of both runs were not looked at, as they are more than MAX_LOGS.
    """

    listed: tuple[WarningDifference, ...]
    n: int
    n_logs: int
    unread: tuple[str, ...] = ()
    n_left_out: int = 0


@dataclass(frozen=True)
class LinkTarget:
    """A warning or conflict that has an anchor in a page: the anchor's name, a description, and the verdict."""

    anchor_name: str
    words: str
    verdict: str


class PageAddresses:
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
        self._run = read_reported_run(source, lambda metric: False)
        self._page = quote(page.strip(), safe=UNESCAPED_URL_CHARACTERS)
        self._known: dict[str, list[PageLink]] = {}

    def warning_and_conflict_links_of_check(self, gate: str, check: GateCheck) -> list[PageLink]:
        """Return links to the warnings and conflicts that a gate asks about, of its log or of all logs."""
        if WARNING_METRIC_PREFIX not in gate and WARNING_METRIC_PREFIX not in check.detail:
            return []
        is_any = not check.log or not self._run.is_folder
        entries = [entry for entry in self._run.entries if is_any or entry.id == check.log]
        found: list[PageLink] = []
        for entry in entries[:MAX_LOGS_READ_FOR_LINKS]:
            found += self._links_of_log(entry)
            if len(found) >= MAX_LINKS_PER_CHECK:
                break
        return found[:MAX_LINKS_PER_CHECK]

    def _links_of_log(self, entry: LogEntry) -> list[PageLink]:
        """Return the links of a log, which is read once; none of more than `MAX_LOGS_READ_FOR_LINKS` logs."""
        if entry.id not in self._known:
            is_unread = entry.log is None or entry.has_failed or len(self._known) >= MAX_LOGS_READ_FOR_LINKS
            self._known[entry.id] = [] if is_unread else self._read_links(entry)
        return self._known[entry.id]

    def _read_links(self, entry: LogEntry) -> list[PageLink]:
        """Read a log's warnings and conflicts as links."""
        whose = f"{entry.id}: " if len(self.entries) > 1 else ""
        return [
            PageLink(f"{whose}{each.words}", self.address_of_anchor(each.anchor_name))
            for each in self.read_warning_and_conflict_anchors(entry) or ()
        ]

    def read_warning_and_conflict_anchors(self, entry: LogEntry, name: str = "") -> list[LinkTarget] | None:
        """Read which warnings and conflicts of a log have an anchor; None if the log failed or can't be read.

        Args:
            name: What anchors are made of; "": as in the page.
        """
        if entry.log is None or entry.has_failed:
            return None
        try:
            with Log.open(entry.log if self.is_folder else self._source) as log:
                return _find_link_targets(log, name or self.anchor_log_name(entry))
        except CwcliError:
            return None

    def anchor_log_name(self, entry: LogEntry) -> str:
        """Return the log's name that its anchors are derived from.

        Raises:
            InputError: The log can't be read.
        """
        if self.is_folder:
            return entry.name
        with Log.open(self._source) as log:
            return log.name.rpartition("/")[2]

    def address_of_anchor(self, anchor_name: str) -> str:
        """Return the address of an anchor in the page."""
        return f"{self._page}#{anchor_name}"

    @property
    def entries(self) -> tuple[LogEntry, ...]:
        """The logs of the run."""
        return self._run.entries

    @property
    def is_folder(self) -> bool:
        """Whether the run is the output of `cwcli run -d`."""
        return self._run.is_folder


def compare_warnings_of_runs(early: PageAddresses, late: PageAddresses) -> WarningDifferences:
    """Compare the warnings and missed conflicts of two runs; logs are paired by id, two single logs always.

    A warning is the same one where its name is (`cwcli.report.pairs`): whom it was of, by which rule, and how
    many such came before it.

    Args:
        early, late: Two runs. Links are to the later one's page.
    """
    known = {entry.id: entry for entry in early.entries}
    if not (early.is_folder or late.is_folder):
        known = {entry.id: early.entries[0] for entry in late.entries}
    pairs = [(known[entry.id], entry) for entry in late.entries if entry.id in known]
    found: dict[str, list[WarningDifference]] = {"new": [], "other": [], "gone": []}
    unread = []
    for first, entry in pairs[:MAX_LOGS_READ_FOR_LINKS]:
        name = late.anchor_log_name(entry)
        before, after = (
            early.read_warning_and_conflict_anchors(first, name),
            late.read_warning_and_conflict_anchors(entry, name),
        )
        if before is None or after is None:
            unread.append(entry.id)
            continue
        was, now = ({each.anchor_name: each for each in marked} for marked in (before, after))
        whose = f"{entry.id}: " if len(late.entries) > 1 else ""
        for mark, each in now.items():
            words = f"{whose}{each.words}"
            if mark not in was:
                found["new"].append(WarningDifference("new", words, late.address_of_anchor(mark)))
            elif was[mark].verdict != each.verdict:
                words += f" (before: {was[mark].verdict})"
                found["other"].append(WarningDifference("other", words, late.address_of_anchor(mark)))
        found["gone"] += [
            WarningDifference("gone", f"{whose}{each.words}", "") for mark, each in was.items() if mark not in now
        ]
    every = [each for kind in found.values() for each in kind]
    n_read = len(pairs[:MAX_LOGS_READ_FOR_LINKS])
    return WarningDifferences(
        tuple(every[:MAX_LINKS_PER_CHECK]), len(every), n_read - len(unread), tuple(unread), len(pairs) - n_read
    )


def _find_link_targets(log: Log, name: str) -> list[LinkTarget]:
    """Find what has an anchor in a log's page: false and missed warnings first, then those that came true."""
    drive_encounters = find_encounters(read_drive(log))
    right: list[LinkTarget] = []
    wrong: list[LinkTarget] = []
    named = zip(warning_anchor_names(name, drive_encounters), drive_encounters.encounters, strict=True)
    for mark, encounter in list(named)[:MAX_PAGE_TABLE_ROWS]:
        badge = badge_of_warning_verdict(encounter)
        targets = right if badge.tone == "alert" else wrong
        words = f"warning {encounter.event_id}, {name_of_other(encounter)}: {badge.text}"
        targets.append(LinkTarget(mark, words, badge.text.partition(",")[0]))
    missed = [
        LinkTarget(mark, f"{words}: not warned of", "not warned of")
        for mark, words in unwarned_conflict_links(drive_encounters, name)
    ]
    return [*wrong, *missed, *right]
