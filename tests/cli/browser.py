"""Opens a page in headless Chromium and tells what became of it."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import time
from dataclasses import dataclass
from fcntl import F_DUPFD_CLOEXEC, fcntl
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
TIMEOUT_S = 600
CONSOLE = re.compile(r":CONSOLE[:(]\d+\)?\]\s*(.*)")


@dataclass(frozen=True)
class Visit:
    """What the browser made of a page.

    Attributes:
        dom: The document after its scripts have run.
        console: What was written to the console: errors, warnings, violations of the content security policy.
        urls: Every address that was asked for, but those of `file:`, `data:` and `blob:`.
    """

    dom: str
    console: tuple[str, ...]
    urls: tuple[str, ...]


def browser() -> str:
    """The browser's program; skips the test where there is none."""
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    if found is None:
        pytest.skip("no Chromium is installed (Debian: apt-get install chromium)")
    return found


def visit(page: Path, folder: Path, *, size: str = "1366,768", screenshot: Path | None = None) -> Visit:
    """Open a page, wait for its scripts, and close the browser again.

    Args:
        folder: For the browser's own files.
        size: Width and height of the window.
        screenshot: Where to put a picture of the window, or None.
    """
    net_log = folder / "net.json"
    command = [
        browser(),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        f"--user-data-dir={folder / 'profile'}",
        f"--log-net-log={net_log}",
        f"--window-size={size}",
        "--virtual-time-budget=60000",
        "--enable-logging=stderr",
        "--dump-dom",
        *([f"--screenshot={screenshot}"] if screenshot else []),
        page.resolve().as_uri(),
    ]
    done = subprocess.run(command, capture_output=True, check=False, timeout=TIMEOUT_S)
    talk = done.stderr.decode("utf-8", "replace")
    assert done.returncode == 0, talk[-2000:]
    return Visit(done.stdout.decode("utf-8", "replace"), tuple(CONSOLE.findall(talk)), _requested(net_log))


@dataclass(frozen=True)
class Opening:
    """Seconds from the navigation to a page's first paint, to its load event, and until its scripts rest."""

    paint_s: float
    load_s: float
    rest_s: float


def time_opening(page: Path, folder: Path) -> Opening:
    """Open a page in a window and tell how long it took, by the browser's own clock.

    The browser is spoken to through pipes (`--remote-debugging-pipe`): messages of JSON with a zero byte at the end.
    """
    to_browser, from_browser = os.pipe(), os.pipe()
    theirs = [fcntl(each, F_DUPFD_CLOEXEC, 10) for each in (to_browser[0], from_browser[1])]
    os.close(to_browser[0])
    os.close(from_browser[1])
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--window-size=1366,768"]
    command = [browser(), *options, f"--user-data-dir={folder / 'profile'}", "--remote-debugging-pipe", "about:blank"]
    places = [
        *((os.POSIX_SPAWN_OPEN, stream, os.devnull, os.O_WRONLY, 0) for stream in (1, 2)),
        *((os.POSIX_SPAWN_DUP2, each, place) for each, place in zip(theirs, (3, 4), strict=True)),
    ]
    process = os.posix_spawn(command[0], command, os.environ, file_actions=places)
    for each in theirs:
        os.close(each)
    with os.fdopen(to_browser[1], "wb", buffering=0) as ask, os.fdopen(from_browser[0], "rb") as answers:
        n_calls = 0

        def call(method: str, session: str = "", **values: Any) -> dict[str, Any]:
            nonlocal n_calls
            n_calls += 1
            message = {"id": n_calls, "method": method, "params": values} | ({"sessionId": session} if session else {})
            ask.write(json.dumps(message).encode() + b"\0")
            while True:
                text = b"".join(iter(lambda: answers.read(1), b"\0"))
                answer: dict[str, Any] = json.loads(text)
                if answer.get("id") == n_calls:
                    assert "result" in answer, answer
                    return dict(answer["result"])

        pages = [each for each in call("Target.getTargets")["targetInfos"] if each["type"] == "page"]
        session = call("Target.attachToTarget", targetId=pages[0]["targetId"], flatten=True)["sessionId"]
        call("Page.navigate", session, url=page.resolve().as_uri())
        begin = time.monotonic()
        while time.monotonic() - begin < TIMEOUT_S:
            found = call("Runtime.evaluate", session, expression=OPENING, awaitPromise=True, returnByValue=True)
            if value := found["result"].get("value"):
                break
            time.sleep(0.05)
        call("Browser.close")
    os.waitpid(process, 0)
    paint_ms, load_ms, rest_ms = value
    return Opening(paint_ms / 1e3, load_ms / 1e3, rest_ms / 1e3)


OPENING = """
location.protocol !== "file:" || document.readyState !== "complete" ? null : new Promise(resolve =>
  requestIdleCallback(() => {
    const paint = performance.getEntriesByName("first-contentful-paint")[0];
    const load = performance.getEntriesByType("navigation")[0].loadEventEnd;
    resolve(paint && load ? [paint.startTime, load, performance.now()] : null);
  }))
"""
"""Tells the times of an opened page [ms since the navigation], null before it is open."""


def _requested(net_log: Path) -> tuple[str, ...]:
    """Addresses in the browser's network log that are about the page: not the browser's own to its maker."""
    text = net_log.read_text(encoding="utf-8", errors="replace")
    found = set(re.findall(r'"url":"([a-z]+:[^"]*)"', text))
    own = ("file:", "data:", "blob:", "chrome", "devtools:", "about:")
    makers = ("google.com", "googleapis.com", "gvt1.com", "gstatic.com")
    return tuple(
        sorted(
            url
            for url in found
            if not url.startswith(own) and not any(maker in url.split("/")[2] for maker in makers if "//" in url)
        )
    )


class Elements(HTMLParser):
    """The elements of a page: (tag, attributes) each, and the text of each script."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str]]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, {name: value or "" for name, value in attrs}))

    def of(self, tag: str) -> list[dict[str, str]]:
        """The attributes of each element of a tag."""
        return [attributes for name, attributes in self.found if name == tag]


def figures(html: str) -> dict[str, dict[str, object]]:
    """The figures that a page holds, by their ids."""
    import base64
    import gzip

    found = re.findall(r'<script type="text/plain" id="(log-[^"]+)">([^<]*)</script>', html)
    return {name: json.loads(gzip.decompress(base64.b64decode(text))) for name, text in found}
