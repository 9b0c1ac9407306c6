"""The whole page: one HTML file that needs nothing else, and takes nothing from the network.

The plotting library and the figures are inside, compressed; the browser unpacks them. A content security policy allows
the two scripts of the page by their hashes, pictures inside the page (and of one server of map tiles, where the user
names it), and nothing else. Same input, same bytes: no
times of day, no random ids.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any

from cwcli.digest.story import Badge
from cwcli.errors import UsageError, install_hint
from cwcli.lazy_dataclass import dataclass
from cwcli.report.pooled import PooledMetric, PooledSource
from cwcli.report.tiles import TileServer
from cwcli.report.views import LogView
from cwcli.text import escape_control_characters

if TYPE_CHECKING:
    from jinja2 import Environment

GZIP_LEVEL = 9
"""The compression level of what the page embeds, the highest."""


@dataclass(frozen=True)
class OverviewRow:
    """One log of the overview; `anchor` is "" without details; `links` are anchors and descriptions of its parts.

    `track` is the SVG path of its thumbnail (`cwcli.report.thumbnail`), "" without one.
    """

    anchor: str
    name: str
    badges: tuple[Badge, ...]
    story: str
    values: tuple[str, ...]
    links: tuple[tuple[str, str], ...] = ()
    track: str = ""


@dataclass(frozen=True)
class GateView:
    """One gate of the run, as the page shows it."""

    expression: str
    badge: Badge
    value: str


@dataclass(frozen=True)
class PageContent:
    """The content of the page around the sections of the logs.

    Plain cells do not name their columns. Rows beyond `n_shown_rows` are shown when they are asked for or found.
    """

    title: str
    headline: str
    sentences: tuple[str, ...]
    badges: tuple[Badge, ...]
    gates: tuple[GateView, ...]
    columns: tuple[str, ...]
    rows: tuple[OverviewRow, ...]
    footer: tuple[str, ...]
    metrics: tuple[PooledMetric, ...] = ()
    sources: tuple[PooledSource, ...] = ()
    n_sources: int = 0
    has_plain_cells: bool = False
    n_shown_rows: int = 0


class PageRenderer:
    """Renders the templates and holds what every page embeds.

    Raises:
        UsageError: The extra `report` is not installed.
    """

    def __init__(self, tiles: TileServer | None = None) -> None:
        """Read the templates.

        Args:
            tiles: What may be drawn below the maps, or None.
        """
        self.tiles = tiles
        self._environment = _template_environment()
        self._css = _read_asset("report.css")
        self._script = _read_asset("report.js")
        library = _plotly_library()
        self._library = _compress_to_base64(library)
        self._policy = "; ".join(
            (
                "default-src 'none'",
                f"script-src '{_script_policy_hash(self._script)}' '{_script_policy_hash(library)}'",
                "style-src 'unsafe-inline'",
                "img-src data: blob:" + (f" {tiles.origin}" if tiles is not None else ""),
                "base-uri 'none'",
                "form-action 'none'",
            )
        )

    @property
    def fixed_size_bytes(self) -> int:
        """Size of what every page holds, in bytes."""
        return len(self._library) + len(self._css) + len(self._script) + 2000

    def render_log_section(self, view: LogView) -> str:
        """Render one log's section as HTML."""
        return self._render_template("log.html", log=view)

    def render_page(self, page: PageContent, sections: Sequence[str]) -> str:
        """Render the whole page as HTML.

        Args:
            sections: What `render_log_section` returned.
        """
        from markupsafe import Markup

        return self._render_template(
            "page.html",
            page=page,
            tiles=self.tiles,
            sections=[Markup(section) for section in sections],
            policy=Markup(self._policy),
            css=Markup(self._css),
            script=Markup(self._script),
            library=Markup(self._library),
        )

    def _render_template(self, name: str, **values: Any) -> str:
        return self._environment.get_template(name).render(**values)


def _template_environment() -> Environment:
    """Load the templates; every value is escaped, and its invisible characters are spelled out."""
    try:
        from jinja2 import Environment, FunctionLoader, StrictUndefined
    except ModuleNotFoundError as error:
        raise _missing_package_error("jinja2") from error
    from markupsafe import Markup

    macros = _read_asset("macros.html")

    def load_template(name: str) -> str:
        imports = (
            "{% from 'macros.html' import badge, badge_list, plot, frames, player, table, odd_logs, gate_table %}\n"
        )
        return macros if name == "macros.html" else imports + _read_asset(name)

    def spell_out_invisible(value: Any) -> Any:
        return escape_control_characters(value) if type(value) is str else value

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        loader=FunctionLoader(load_template),
        finalize=spell_out_invisible,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["listed"] = lambda value: Markup(json.dumps(value, separators=(",", ":"), allow_nan=False))
    environment.filters["packed"] = lambda value: Markup(compress_json_to_base64(value))
    return environment


def compress_json_to_base64(value: Any) -> str:
    """Encode a value as compressed JSON in base64, which HTML can't misread."""
    return _compress_to_base64(json.dumps(value, separators=(",", ":"), allow_nan=False))


def _compress_to_base64(text: str) -> str:
    """Compress a text and encode it in base64."""
    return base64.b64encode(gzip.compress(text.encode(), GZIP_LEVEL, mtime=0)).decode("ascii")


def _read_asset(name: str) -> str:
    """Read a template, style sheet or script of the package."""
    return (resources.files("cwcli.report") / "assets" / name).read_text(encoding="utf-8")


def _plotly_library() -> str:
    """Return the source of the plotting library."""
    try:
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError as error:
        raise _missing_package_error("plotly") from error
    library: str = get_plotlyjs()
    return library


def _missing_package_error(package: str) -> UsageError:
    """Return the error for a package that is not installed."""
    return UsageError(f"the report needs the package {package}", hint=install_hint("report"))


def _script_policy_hash(script: str) -> str:
    """Return the hash by which a content security policy allows a script."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode('ascii')}"
