"""Tiles below the map: only where the user names a server, which then learns where the drive was."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass

MAX_TEMPLATE_CHARACTERS = 500
"""The greatest length of the address template, in characters. Chosen by hand; not fitted."""
MAX_ATTRIBUTION_CHARACTERS = 200
"""The greatest length of the attribution, in characters. Chosen by hand; not fitted."""
TILE_HOST_PATTERN = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?\.?|\[[0-9A-Fa-f:.]+\]")
"""Pattern of a host name or an address in brackets."""
TILE_ADDRESS_TEMPLATE_PATTERN = re.compile(r"[A-Za-z0-9\-._~:/?#\[\]@!$&()*+,=%{}]+")
"""Pattern of an address template: the characters of an address without quotes, semicolons and spaces."""
TILE_OPTIONS_EXAMPLE = (
    "e.g. --tiles 'https://tiles.example.org/{z}/{x}/{y}.png' --tiles-attribution '© the makers of the map'"
)
"""Example of both options, for hints of errors."""


@dataclass(frozen=True)
class TileServer:
    """A server of map tiles in Web Mercator (EPSG:3857), 256 pixels wide.

    Attributes:
        template: Its address with `{z}`, `{x}` and `{y}`.
        attribution: Whose map it is; it stands on the map.
        origin: Scheme, host and port: the only place that the page may take pictures from.
    """

    template: str
    attribution: str
    origin: str


def parse_tile_server(template: str | None, attribution: str | None) -> TileServer | None:
    """Parse the server of map tiles that the options name; None if they name none.

    Raises:
        UsageError: An option is missing or empty, or the template is no address of tiles.
    """
    if template is None:
        if attribution is not None:
            raise UsageError("--tiles-attribution without --tiles", hint=TILE_OPTIONS_EXAMPLE)
        return None
    if not (attribution or "").strip() or len(attribution or "") > MAX_ATTRIBUTION_CHARACTERS:
        what = f"--tiles needs --tiles-attribution: whose map it is, in at most {MAX_ATTRIBUTION_CHARACTERS} characters"
        raise UsageError(what, hint=TILE_OPTIONS_EXAMPLE)
    try:
        parts = urlsplit(template)
        host, port = parts.hostname or "", parts.port
    except ValueError as error:
        raise _invalid_tiles_error(str(error)) from error
    if len(template) > MAX_TEMPLATE_CHARACTERS or not TILE_ADDRESS_TEMPLATE_PATTERN.fullmatch(template):
        raise _invalid_tiles_error(f"it holds what no address holds, or more than {MAX_TEMPLATE_CHARACTERS} characters")
    if parts.scheme not in ("http", "https"):
        raise _invalid_tiles_error("it does not begin with http:// or https://")
    if parts.username is not None or parts.password is not None:
        raise _invalid_tiles_error("it holds a name or a password, which everybody could read who has the page")
    host = f"[{host}]" if ":" in host else host
    if "_" in host:  # no host of a content security policy may hold one (CSP 3, 2.3.1): the source would be ignored
        raise _invalid_tiles_error(
            "its host holds an underscore, and browsers take no pictures from such; give its IP address"
        )
    if not TILE_HOST_PATTERN.fullmatch(host):
        raise _invalid_tiles_error("it names no host")
    rest = f"{parts.path}?{parts.query}"
    if parts.fragment or any(rest.count(f"{{{name}}}") != 1 for name in "zxy"):
        raise _invalid_tiles_error("behind the host {z}, {x} and {y} must stand once each")
    if set(re.sub(r"\{[zxy]\}", "", template)) & set("{}"):
        raise _invalid_tiles_error("only {z}, {x} and {y} can be filled in")
    origin = f"{parts.scheme}://{host}" + (f":{port}" if port is not None else "")
    return TileServer(template, (attribution or "").strip(), origin)


def _invalid_tiles_error(why: str) -> UsageError:
    """Return the error for an unusable template."""
    return UsageError(f"--tiles is not an address of map tiles: {why}", hint=TILE_OPTIONS_EXAMPLE)
