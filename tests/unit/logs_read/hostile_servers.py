"""Web servers that are slow, endless, lying, redirecting, encoding or cutting: what each sends, byte by byte."""

from __future__ import annotations

import base64
import gzip
import socket
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

Answer = Callable[[socket.socket, str, int], None]
"""Answers a request: the connection, the head of the request, and how many came before it."""
MAGIC = b"\x89MCAP0\r\n"
SECRET = "pl4nt3d"
SECRETS = SECRET, SECRET[:-2], base64.b64encode(f"{SECRET}:{SECRET}".encode()).decode()
"""A planted secret is looked for as it is, cut, and as the header of a request carries user and password."""


def head(status: str = "200 OK", **fields: str) -> bytes:
    lines = [f"HTTP/1.1 {status}", *(f"{name.replace('_', '-')}: {value}" for name, value in fields.items())]
    return "\r\n".join([*lines, "Connection: close", "", ""]).encode()


@contextmanager
def serve(answer: Answer) -> Iterator[str]:
    """Serve on this machine; yields the address with a user and a password."""
    n_requests = 0
    is_over = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def accept() -> None:
            nonlocal n_requests
            while not is_over.is_set():
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                threading.Thread(target=handle, args=(connection, n_requests), daemon=True).start()
                n_requests += 1

        def handle(connection: socket.socket, number: int) -> None:
            with connection, suppress(OSError):
                asked = b""
                while b"\r\n\r\n" not in asked:
                    asked += connection.recv(4096)
                answer(connection, asked.decode("latin-1"), number)

        threading.Thread(target=accept, daemon=True).start()
        try:
            yield f"http://{SECRET}:{SECRET}@127.0.0.1:{server.getsockname()[1]}/drive.mcap?sig={SECRET}"
        finally:
            is_over.set()


def send(*pieces: bytes) -> Answer:
    def answer(connection: socket.socket, *_: object) -> None:
        for piece in pieces:
            connection.sendall(piece)

    return answer


def drip(begin: bytes, piece: bytes = b"x", every_s: float = 0.05) -> Answer:
    """Some bytes, then one after the other without end."""

    def answer(connection: socket.socket, *_: object) -> None:
        connection.sendall(begin)
        while True:
            connection.sendall(piece)
            time.sleep(every_s)

    return answer


def hang(begin: bytes = b"") -> Answer:
    """Some bytes, then nothing."""

    def answer(connection: socket.socket, *_: object) -> None:
        connection.sendall(begin)
        connection.recv(1)

    return answer


def endless(begin: bytes, piece: bytes) -> Answer:
    def answer(connection: socket.socket, *_: object) -> None:
        connection.sendall(begin)
        while True:
            connection.sendall(piece)

    return answer


def redirect(location: str, status: str = "302 Found") -> Answer:
    return send(head(status, Location=location, Content_Length="0"))


def redirect_to_header(connection: socket.socket, asked: str, number: int) -> None:
    credentials = asked.partition("Authorization: Basic ")[2].partition("\r\n")[0]
    connection.sendall(head("302 Found", Location=f"ftp://127.0.0.1/{credentials}", Content_Length="0"))


def redirect_to_twice_the_path(connection: socket.socket, asked: str, number: int) -> None:
    path = asked.split()[1].partition("?")[0]
    connection.sendall(head("302 Found", Location=f"{path * 8}?sig={SECRET}", Content_Length="0"))


def redirect_farther(connection: socket.socket, asked: str, number: int) -> None:
    connection.sendall(head("302 Found", Location=f"/{number}", Content_Length="0"))


def resumed(log: bytes, answer_of_rest: Callable[[bytes, int], bytes]) -> Answer:
    """Half of a log, and then what is made of the other half."""
    half = len(log) // 2

    def answer(connection: socket.socket, asked: str, number: int) -> None:
        if "Range:" not in asked:
            connection.sendall(head(Content_Length=str(len(log)), ETag='"one"') + log[:half])
        else:
            connection.sendall(answer_of_rest(log[half:], half))

    return answer


def partial(rest: bytes, first: int, total: int, etag: str = '"one"') -> bytes:
    described = f"bytes {first}-{first + len(rest) - 1}/{total}"
    return head("206 Partial Content", Content_Range=described, Content_Length=str(len(rest)), ETag=etag) + rest


ZEROS = bytes(1 << 16)
GZIP_BOMB = gzip.compress(MAGIC + bytes(60_000_000), 1)
STALL = "did not send 1,000 bytes within 3 s|the server did not answer in time"  # the latter where the machine is busy
BROKEN = "the connection broke before the whole file had come"
NO_LOG = "not an MCAP file|no MCAP file"
HOSTILE_SERVERS: dict[str, tuple[Answer, str]] = {
    "accepts and says nothing": (hang(), STALL),
    "begins a status": (hang(b"HTTP/1.1 20"), STALL),
    "begins a header": (hang(b"HTTP/1.1 200 OK\r\nA: b"), STALL),
    "sends a header byte by byte": (drip(b"HTTP/1.1 200 OK\r\nA: "), STALL),
    "sends headers without end": (drip(b"HTTP/1.1 200 OK\r\n", b"A: b\r\n", 0.2), STALL),
    "sends 1,000 headers": (send(b"HTTP/1.1 200 OK\r\n" + b"A: b\r\n" * 1000), "can't be read"),
    "sends a header of 1 MB": (send(b"HTTP/1.1 200 OK\r\nA: " + b"b" * 1_000_000), "can't be read"),
    "says 100 Continue without end": (drip(b"", b"HTTP/1.1 100 Continue\r\n\r\n", 0.2), STALL),
    "sends a head and nothing else": (hang(head(Content_Length="1000")), STALL),
    "stalls in the magic": (hang(head(Content_Length="1000") + MAGIC[:4]), STALL),
    "stalls behind the magic": (hang(head(Content_Length="1000") + MAGIC), STALL),
    "sends a body byte by byte": (drip(head() + MAGIC), STALL),
    "sends ten bytes a time": (drip(head() + MAGIC, b"0123456789", 0.1), STALL),
    "sends zeros without end": (endless(head(), ZEROS), NO_LOG),
    "sends text without end": (endless(head(), b"<html>" * 1000), NO_LOG),
    "sends a log without end": (endless(head() + MAGIC, ZEROS), "more than 0.02 GB were received"),
    "sends chunks without end": (
        endless(head(Transfer_Encoding="chunked") + b"8\r\n" + MAGIC + b"\r\n", b"10000\r\n" + ZEROS + b"\r\n"),
        "more than 0.02 GB were received",
    ),
    "sends chunks of a wrong size": (
        send(head(Transfer_Encoding="chunked") + b"8\r\n" + MAGIC + b"\r\nxyz\r\n"),
        f"can't be read|{BROKEN}",
    ),
    "sends a chunk that is cut": (send(head(Transfer_Encoding="chunked") + b"ffff\r\n" + MAGIC), BROKEN),
    "declares a negative length": (send(head(Content_Length="-5") + MAGIC), "damaged|cut|can't be read|short"),
    "declares no number as length": (send(head(Content_Length="many") + MAGIC), "damaged|cut|can't be read|short"),
    "declares 10^30 bytes": (send(head(Content_Length=str(10**30)) + MAGIC), BROKEN),
    "sends less than it declares": (send(head(Content_Length="5000") + MAGIC + ZEROS[:100]), BROKEN),
    "sends nothing": (send(head(Content_Length="0")), "no data was received"),
    "closes at once": (send(), BROKEN),
    "speaks no HTTP": (send(b"220 ftp ready\r\n\r\n"), "can't be read"),
    "redirects to itself": (redirect("/drive.mcap"), "redirects more than 5 times|redirect"),
    "redirects without end": (redirect_farther, "redirects more than 5 times"),
    "redirects to a file": (redirect("file:///etc/passwd"), "redirects to file:///etc/passwd, which is not followed"),
    "redirects to ftp": (redirect("ftp://127.0.0.1/x"), "redirects to ftp://127.0.0.1/x, which is not followed"),
    "redirects to data": (redirect("data:text/plain,x"), "which is not followed"),
    "redirects to nowhere": (redirect("http://127.0.0.1:1/", "307 Temporary Redirect"), "refused the connection"),
    "redirects to longer paths": (redirect_to_twice_the_path, "redirects more than 5 times|can't be read"),
    "redirects to a path of 60 kB": (redirect("/" + "a" * 60_000), "redirects more than 5 times"),
    "redirects to 15,000 addresses in one": (redirect("/" + "a://" * 15_000), "redirects more than 5 times"),
    "redirects to the password": (redirect_to_header, "redirects to ftp://127.0.0.1/[*]{3}, which is not followed"),
    "redirects to a password that is cut": (
        redirect(f"ftp://127.0.0.1/{'x' * 179}{SECRET}"),
        "redirects to ftp://127.0.0.1/x+[*]+, which is not followed",
    ),
    "redirects without a target": (send(head("302 Found", Content_Length="0")), "status 302|can't be read"),
    "sends a gzip bomb": (
        send(head(Content_Encoding="gzip", Content_Length=str(len(GZIP_BOMB))) + GZIP_BOMB),
        "more than 0.02 GB were received|unpacks to too much",
    ),
    "sends a cut gzip": (send(head(Content_Encoding="gzip") + GZIP_BOMB[:12]), f"{BROKEN}|no data"),
    "sends no gzip": (send(head(Content_Encoding="gzip") + b"x" * 2000), "can't be unpacked"),
    "sends brotli": (send(head(Content_Encoding="br") + b"x" * 2000), "in the encoding 'br', which is not read"),
    "sends two encodings": (send(head(Content_Encoding="gzip, br") + b"x" * 2000), "which is not read"),
    "sends an encoding with a password that is cut": (
        send(head(Content_Encoding="b" * 35 + SECRET) + b"x" * 2000),
        "in the encoding 'b+[*]+', which is not read",
    ),
    "says 60 kB of reasons": (send(head("400 " + "no " * 20_000, Content_Length="0")), "can't be read"),
    "sends chunks of a negative size": (
        send(head(Transfer_Encoding="chunked") + b"-8\r\n" + MAGIC + ZEROS),
        BROKEN,
    ),
    "sends trailers without end": (
        endless(head(Transfer_Encoding="chunked") + b"8\r\n" + MAGIC + b"\r\n0\r\n", b"A: b\r\n" * 1000),
        STALL,
    ),
    "asks for a password": (send(head("401 Unauthorized", Content_Length="0")), "does not allow it"),
    "has too much to do": (send(head("503 Service Unavailable", Content_Length="0")), "try again later|can't answer"),
}
"""Name -> what the server does, and a pattern of what is said of it."""


def good_gzip(log: bytes) -> Answer:
    packed = gzip.compress(log)
    return send(head(Content_Encoding="gzip", Content_Length=str(len(packed))) + packed)


def good_deflate(log: bytes) -> Answer:
    return send(head(Content_Encoding="deflate") + zlib.compress(log))
