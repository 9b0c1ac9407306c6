"""Tiles below the map: only where the user names a server, which then learns where the drive was."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from cwcli.errors import UsageError

MAX_TEMPLATE = 500
"""The greatest length of the address template, in characters. Chosen by hand; not fitted."""
MAX_ATTRIBUTION = 200
"""The greatest length of the attribution, in characters. Chosen by hand; not fitted."""
HOST = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?\.?|\[[0-9A-Fa-f:.]+\]")
"""Pattern of a host name or an address in brackets."""
ALLOWED = re.compile(r"[A-Za-z0-9\-._~:/?#\[\]@!$&()*+,=%{}]+")
"""Pattern of an address template: the characters of an address without quotes, semicolons and spaces."""
EXAMPLE = "e.g. --tiles 'https://tiles.example.org/{z}/{x}/{y}.png' --tiles-attribution '© the makers of the map'"
"""Example of both options, for hints of errors."""


@dataclass(frozen=True)
class Tiles:
    """A server of map tiles in Web Mercator (EPSG:3857), 256 pixels wide.

    Attributes:
        template: Its address with `{z}`, `{x}` and `{y}`.
        attribution: Whose map it is; it stands on the map.
        origin: Scheme, host and port: the only place that the page may take pictures from.
    """

    template: str
    attribution: str
    origin: str


def parse_tiles(template: str | None, attribution: str | None) -> Tiles | None:
    """Parse the server of map tiles that the options name; None if they name none.

    Raises:
        UsageError: An option is missing or empty, or the template is no address of tiles.
    """
    if template is None:
        if attribution is not None:
            raise UsageError("--tiles-attribution without --tiles", hint=EXAMPLE)
        return None
    if not (attribution or "").strip() or len(attribution or "") > MAX_ATTRIBUTION:
        what = f"--tiles needs --tiles-attribution: whose map it is, in at most {MAX_ATTRIBUTION} characters"
        raise UsageError(what, hint=EXAMPLE)
    try:
        parts = urlsplit(template)
        host, port = parts.hostname or "", parts.port
    except ValueError as error:
        raise _wrong(str(error)) from error
    if len(template) > MAX_TEMPLATE or not ALLOWED.fullmatch(template):
        raise _wrong(f"it holds what no address holds, or more than {MAX_TEMPLATE} characters")
    if parts.scheme not in ("http", "https"):
        raise _wrong("it does not begin with http:// or https://")
    if parts.username is not None or parts.password is not None:
        raise _wrong("it holds a name or a password, which everybody could read who has the page")
    host = f"[{host}]" if ":" in host else host
    if "_" in host:  # no host of a content security policy may hold one (CSP 3, 2.3.1): the source would be ignored
        raise _wrong("its host holds an underscore, and browsers take no pictures from such; give its IP address")
    if not HOST.fullmatch(host):
        raise _wrong("it names no host")
    rest = f"{parts.path}?{parts.query}"
    if parts.fragment or any(rest.count(f"{{{name}}}") != 1 for name in "zxy"):
        raise _wrong("behind the host {z}, {x} and {y} must stand once each")
    if set(re.sub(r"\{[zxy]\}", "", template)) & set("{}"):
        raise _wrong("only {z}, {x} and {y} can be filled in")
    origin = f"{parts.scheme}://{host}" + (f":{port}" if port is not None else "")
    return Tiles(template, (attribution or "").strip(), origin)


def _wrong(why: str) -> UsageError:
    """Return the error for an unusable template."""
    return UsageError(f"--tiles is no address of map tiles: {why}", hint=EXAMPLE)
