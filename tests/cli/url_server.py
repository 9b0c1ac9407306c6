"""An HTTP server on this machine that serves logs, or fails in every way; and a search for a word in all files."""

from __future__ import annotations

import base64
import io
import re
import threading
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pyarrow.parquet as pq
from mcap.stream_reader import StreamReader

SECRET = "pl4nt3d"
"""Stands in every part of a URL that may be secret, and nowhere else."""
USER = f"{SECRET}user:{SECRET}%2Fword"
QUERY = (
    f"X-Amz-Credential={SECRET}cred%2F20260101&X-Amz-Signature={SECRET}sign&X-Amz-Security-Token={SECRET}%2Btoken%3D"
    f"&sig={SECRET}sas&token={SECRET}tok&path=a/{SECRET}unknown"
)
FRAGMENT = f"{SECRET}fragment"


@contextmanager
def serve_logs(files: dict[str, Path]) -> Iterator[int]:
    """Serve files by their paths, and `/status/CODE/...` with that status; yields the port.

    `/cut/...` says that a file is longer than what comes.
    """

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_HEAD(self) -> None:
            self._answer(has_body=False)

        def do_GET(self) -> None:
            self._answer(has_body=True)

        def log_message(self, format: str, *arguments: Any) -> None:
            """Say nothing."""

        def _answer(self, *, has_body: bool) -> None:
            path = urlsplit(self.path).path
            if path.startswith("/status/"):
                return self._send(int(path.split("/")[2]), self.path.encode(), has_body)
            is_cut = path.startswith("/cut/")
            file = files.get(path.removeprefix("/cut"))
            if file is None:
                return self._send(404, self.path.encode(), has_body)
            data = file.read_bytes()
            return self._send(200, data[: len(data) // 2] if is_cut else data, has_body, len(data), close=is_cut)

        def _send(self, status: int, body: bytes, has_body: bool, length: int = -1, *, close: bool = False) -> None:
            self.send_response(status)
            self.send_header("Content-Length", str(length if length >= 0 else len(body)))
            self.send_header("ETag", '"one"')
            if close:
                self.send_header("Connection", "close")
            self.end_headers()
            if has_body:
                self.wfile.write(body)
            self.close_connection = self.close_connection or close

    class Server(ThreadingHTTPServer):
        daemon_threads = True

        def handle_error(self, request: Any, client_address: Any) -> None:
            """Say nothing of clients that go away."""

    server = Server(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def secret_url(port: int, path: str) -> str:
    """A URL of the server with a secret wherever one may stand."""
    return f"http://{USER}@127.0.0.1:{port}{path}?{QUERY}#{FRAGMENT}"


def places_of(word: str, folder: Path) -> list[str]:
    """The files below a folder whose names or contents hold a word, whatever its case and however it is packed."""
    wanted = _spellings(word)
    found = []
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if _holds([name.encode("utf-8", "surrogateescape")], wanted):
            found.append(f"name: {name}")
        if path.is_file() and _holds(contents(path.read_bytes()), wanted):
            found.append(f"content: {name}")
    return found


def contents(data: bytes) -> Iterator[bytes]:
    """A file's bytes, and what is packed in it: chunks of logs, columns of tables, members of archives, streams."""
    yield data
    if data.startswith(b"\x89MCAP0\r\n"):
        for record in StreamReader(io.BytesIO(data)).records:
            yield repr(record).encode()
            yield from (each for each in vars(record).values() if isinstance(each, bytes))
    elif data.startswith(b"PAR1"):
        table = pq.read_table(io.BytesIO(data))
        yield repr(table.schema.to_string(show_field_metadata=True, show_schema_metadata=True)).encode()
        yield repr(table.to_pydict()).encode()
    elif data.startswith(b"PK\x03\x04"):
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for member in archive.infolist():
                yield member.filename.encode()
                yield from contents(archive.read(member))
    for packed in re.findall(rb"[A-Za-z0-9+/]{200,}={0,2}", data):
        unpacked = base64.b64decode(packed[: len(packed) // 4 * 4])
        yield unpacked
        for window in (zlib.MAX_WBITS | 32, -zlib.MAX_WBITS):
            try:
                yield zlib.decompressobj(window).decompress(unpacked)
            except zlib.error:
                continue


def _spellings(word: str) -> list[bytes]:
    """The word, and how base64 spells it at each of the three offsets, without what depends on its neighbours."""
    plain = word.encode()
    encoded = [
        base64.b64encode(b"\0" * shift + plain)[-(-shift * 4 // 3) : (shift + len(plain)) * 4 // 3]
        for shift in range(3)
    ]
    return [plain, plain.decode().encode("utf-16-le"), *encoded]


def _holds(pieces: Iterable[bytes], wanted: list[bytes]) -> bool:
    plain = wanted[:2]
    return any(
        any(word in piece.lower() for word in plain) or any(word in piece for word in wanted[2:]) for piece in pieces
    )


def holds_word(word: str, data: bytes) -> bool:
    """Whether words that were printed hold a word."""
    return _holds([data], _spellings(word))
