"""What the templates are given: plain values, made ready for the page."""

from __future__ import annotations

from dataclasses import field

from cwcli.digest.story import Badge, Story
from cwcli.lazy_dataclass import dataclass
from cwcli.report.drawing import Figure


@dataclass(frozen=True)
class Plot:
    """A figure in the page.

    Attributes:
        height_px: 0 where its kind says.
        origin: Of a map that lies on the earth: latitude and longitude [deg] and altitude [m], else "".
    """

    id: str
    kind: str
    title: str
    hint: str
    figure: Figure
    height_px: int = 0
    origin: str = ""


@dataclass(frozen=True)
class Picture:
    """A camera frame in the page; at_s: since the log began."""

    uri: str
    width_px: int
    height_px: int
    alt: str
    caption: str
    at_s: float


@dataclass(frozen=True)
class Player:
    """The camera's frames, of which the one at the marked moment is shown.

    Attributes:
        first: The first picture, as a data address.
        width_px, height_px: Of each.
        start_s, end_s: What the slider covers, since the log began.
        moments: Time of each frame since the log began, and its JPEG file in base64.
    """

    first: str
    width_px: int
    height_px: int
    start_s: float
    end_s: float
    moments: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class TableView:
    """A table in the page: columns are (heading, is it of numbers); row_marks: a name for links to each row."""

    title: str
    columns: tuple[tuple[str, bool], ...]
    rows: tuple[tuple[str, ...], ...]
    hint: str = ""
    is_folded: bool = False
    row_marks: tuple[str, ...] = ()


@dataclass(frozen=True)
class SensorsView:
    """The section on the sensors.

    Attributes:
        verdict: One sentence of the estimator on itself, "" from older logs.
        tables: What it found.
        notes: What each stage remarked, as on the terminal.
        remarks: What explains the figures, a sentence each.
        plots: Each source's residuals.
        n_residuals: How many such figures there could be.
    """

    verdict: str
    tables: tuple[TableView, ...]
    notes: tuple[str, ...]
    remarks: tuple[str, ...] = ()
    plots: tuple[Plot, ...] = ()
    n_residuals: int = 0


@dataclass(frozen=True)
class EventView:
    """A warning in the page; `mark` is the name by which links find it."""

    number: int
    badge: Badge
    sentence: str
    verdict: str
    plots: tuple[Plot, ...]
    table: TableView
    frames: tuple[Picture, ...]
    mark: str = ""


@dataclass(frozen=True)
class LogView:
    """A log in the page; links: anchor and words of what the table of all logs points to."""

    anchor: str
    name: str
    story: Story
    badges: tuple[Badge, ...]
    is_alone: bool
    is_open: bool
    first: tuple[Plot, ...] = ()
    events: tuple[EventView, ...] = ()
    event_table: TableView | None = None
    others: tuple[TableView, ...] = ()
    signals: tuple[Plot, ...] = ()
    frames: tuple[Picture, ...] = ()
    player: Player | None = None
    tables: tuple[TableView, ...] = ()
    sensors: SensorsView | None = None
    system: tuple[TableView, ...] = ()
    links: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = field(default=())
