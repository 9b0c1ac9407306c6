"""Reads a file over HTTP, in one request, with redirects, encodings and lengths checked.

Redirects are few, and lead to `https`, or from `http` to either; nothing else is followed. A password is not sent to
another host. A body that breaks off is asked for again from where it broke, where the server names its version by a
strong `ETag`; a body of another version is refused.

Sources: https://www.rfc-editor.org/rfc/rfc9110, sections 8.4 (encodings), 8.8.3 (ETag), 13.1.5 (If-Range), 14 (ranges)
"""

from __future__ import annotations

import http.client
import re
import urllib.request
import zlib
from collections.abc import Callable, Iterator
from typing import IO, Any
from urllib.parse import urljoin, urlsplit, urlunsplit

from cwcli.errors import InputError
from cwcli.logs.read.read_bounds import ReadBounds
from cwcli.url import display_name_of_url, encode_credentials, redact_urls

HTTP_BLOCK_BYTES = 1 << 18
"""Bytes that are read at a time, at most. Chosen by hand."""
MAX_REDIRECTS = 5
"""The greatest number of redirects that are followed. Chosen by hand: stores need one or two."""
MAX_DOWNLOAD_RESUMPTIONS = 3
"""How often a body that breaks off is asked for again. Chosen by hand."""
MAX_SHOWN_URL_CHARS = 200
"""The number of characters of a redirect's target that an error shows. Chosen by hand."""
MAX_SHOWN_ENCODING_CHARS = 40
"""The number of characters of an encoding's name that an error shows. Chosen by hand."""
WEB_SCHEMES = ("http", "https")
"""The schemes that are read here, and to which redirects may lead."""
ZLIB_WINDOW_BITS_OF_ANY_STREAM = zlib.MAX_WBITS | 32
"""The window bits with which zlib unpacks gzip and zlib streams of any window (32: it finds out which)."""
ZLIB_CONTENT_ENCODINGS = ("gzip", "x-gzip", "deflate")
"""Content encodings that are unpacked (RFC 9110, 8.4.1)."""
_CONTENT_RANGE_PATTERN = re.compile(r"bytes (\d{1,18})-(\d{1,18})/(\d{1,18}|\*)$")
"""The pattern of the header that says which range a body is."""


def iter_http_blocks(url: str, bounds: ReadBounds) -> Iterator[bytes]:
    """Yield the bytes of a file in blocks.

    Raises:
        InputError: The server lies, redirects too far, or encodes the file in a way that is not read.
        OSError, http.client.HTTPException: It can't be read.
    """
    with _request_url(url, bounds.timeout_s) as response:
        encoding = response.headers.get("Content-Encoding", "identity").strip().lower()
        if encoding in ZLIB_CONTENT_ENCODINGS:
            yield from _iter_unpacked_body(_iter_response_body(url, response), url, bounds)
        elif encoding in ("identity", ""):
            yield from _iter_body_resuming(url, response, bounds)
        else:
            shown = redact_urls(encoding, url)[:MAX_SHOWN_ENCODING_CHARS]
            what = f"the server sends it in the encoding {shown!r}, which is not read"
            raise InputError(what, where=display_name_of_url(url), hint="copy the log to this machine")


def _iter_body_resuming(url: str, response: Any, bounds: ReadBounds) -> Iterator[bytes]:
    """Yield a body, and where it breaks off, the rest from further requests."""
    version = response.headers.get("ETag", "")
    n_bytes, left = 0, MAX_DOWNLOAD_RESUMPTIONS
    total = response.length
    while True:
        try:
            for block in _iter_response_body(url, response):
                n_bytes += len(block)
                yield block
            return
        except (OSError, http.client.HTTPException):
            if not left or not n_bytes or total is None or not version.startswith('"'):
                raise
            left -= 1
            broken = response
        headers = {"Range": f"bytes={n_bytes}-", "If-Range": version}
        response = _request_url(url, bounds.timeout_s, headers)
        broken.close()
        found = (
            _CONTENT_RANGE_PATTERN.match(response.headers.get("Content-Range", "")) if response.status == 206 else None
        )
        if found is None:
            response.close()
            raise http.client.IncompleteRead(b"", total - n_bytes)
        if int(found[1]) != n_bytes or found[3] not in ("*", str(total)) or response.headers.get("ETag") != version:
            response.close()
            raise InputError(
                "the server sends another range or another file than it was asked for",
                where=display_name_of_url(url),
                hint="try again",
            )


def _iter_response_body(url: str, response: Any) -> Iterator[bytes]:
    """Yield the body of one answer.

    Raises:
        http.client.IncompleteRead: It is shorter than the server says.
    """
    length = response.length
    n_bytes = 0
    while block := response.read1(HTTP_BLOCK_BYTES):
        n_bytes += len(block)
        yield block
    if length is not None and n_bytes < length:
        raise http.client.IncompleteRead(b"", length - n_bytes)


def _iter_unpacked_body(blocks: Iterator[bytes], url: str, bounds: ReadBounds) -> Iterator[bytes]:
    """Yield what a body in gzip or zlib unpacks to.

    Raises:
        InputError: It can't be unpacked, or to more than the bounds allow.
    """
    unpacker = zlib.decompressobj(ZLIB_WINDOW_BITS_OF_ANY_STREAM)
    n_in = n_out = 0
    try:
        for block in blocks:
            n_in += len(block)
            data = block
            while data and not unpacker.eof:
                piece = unpacker.decompress(data, HTTP_BLOCK_BYTES)
                data = unpacker.unconsumed_tail
                n_out += len(piece)
                if n_out > bounds.max_unpacked_bytes(n_in):
                    what = "what the server sends unpacks to too much"
                    raise InputError(what, where=display_name_of_url(url), hint="--max-ratio and --max-input read more")
                if piece:
                    yield piece
        yield unpacker.flush()
    except zlib.error as error:
        raise InputError(f"what the server sends can't be unpacked: {error}", where=display_name_of_url(url)) from error
    if not unpacker.eof:
        raise http.client.IncompleteRead(b"")


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows redirects that keep their promise.

    Args:
        url: The URL as the user gave it. An error names it, and shows none of its secrets.
    """

    max_redirections = max_repeats = MAX_REDIRECTS

    def __init__(self, url: str) -> None:
        self._url = url

    def redirect_request(
        self, req: urllib.request.Request, fp: IO[bytes], code: int, msg: str, headers: Any, newurl: str
    ) -> urllib.request.Request | None:
        """Return the request that follows, without the password if it goes to another host."""
        target = urlsplit(urljoin(req.full_url, newurl))
        is_less_safe = urlsplit(req.full_url).scheme == "https" and target.scheme != "https"
        if target.scheme not in WEB_SCHEMES or is_less_safe:
            raise self._unfollowed_error(newurl)
        following = super().redirect_request(req, fp, code, msg, headers, newurl)
        if following is not None and target.netloc != urlsplit(req.full_url).netloc:
            following.headers.pop("Authorization", None)
        return following

    def http_error_302(self, req: Any, fp: Any, code: int, msg: str, headers: Any) -> Any:
        """Follow one redirect; an endless number of them is told as such."""
        location = headers.get("location") or headers.get("uri") or ""
        target = urlsplit(urljoin(req.full_url, location))
        if location and target.scheme not in WEB_SCHEMES:
            raise self._unfollowed_error(location)
        visited = getattr(req, "redirect_dict", {})
        if sum(visited.values()) >= MAX_REDIRECTS:
            raise InputError(
                f"the server redirects more than {MAX_REDIRECTS} times", where=display_name_of_url(self._url)
            )
        return super().http_error_302(req, fp, code, msg, headers)

    def _unfollowed_error(self, target: str) -> InputError:
        shown = redact_urls(target, self._url)[:MAX_SHOWN_URL_CHARS]
        what = f"the server redirects to {shown}, which is not followed"
        return InputError(what, where=display_name_of_url(self._url))

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302


def _request_url(url: str, timeout_s: float, headers: dict[str, str] | None = None) -> Any:
    """Return the answer to a request for a URL, whose user name and password go into a header."""
    parts = urlsplit(url)
    user, at, host = parts.netloc.rpartition("@")
    plain = urlunsplit((parts.scheme, host, parts.path, parts.query, ""))
    request = urllib.request.Request(plain, headers={"Accept-Encoding": "identity", **(headers or {})})
    if at:
        request.add_unredirected_header("Authorization", f"Basic {encode_credentials(user)}")
    opener = urllib.request.OpenerDirector()
    handlers: list[Callable[[], urllib.request.BaseHandler]] = [
        urllib.request.HTTPHandler,
        urllib.request.HTTPSHandler,
        urllib.request.HTTPDefaultErrorHandler,
        urllib.request.HTTPErrorProcessor,
    ]
    for each in handlers:
        opener.add_handler(each())
    opener.add_handler(_Redirects(url))
    return opener.open(request, timeout=timeout_s)
