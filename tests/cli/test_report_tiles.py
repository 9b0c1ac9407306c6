"""Map tiles below the tracks: only where they are asked for, from one server, in the right places."""

from __future__ import annotations

import json
import math
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
import pytest

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_USAGE, UsageError
from cwcli.logs.read.reader import Log
from cwcli.pipeline.records import local_map_from_estimate_record, read_run_records
from cwcli.report.tiles import parse_tile_server
from tests.cli.browser import Elements, visit
from tests.cli.conftest import SAMPLES

PLACES = """
<script>
(async () => {
  const pause = (ms) => new Promise((done) => setTimeout(done, ms));
  while (document.documentElement.dataset.plots !== "drawn") { await pause(50); }
  const map = document.querySelector(".plot.map"), layer = map.querySelector(".tiles");
  const box = (each) => ["left", "top", "width", "height"].map((name) => parseFloat(each.style[name]));
  const tell = () => [...layer.querySelectorAll("img")].map((each) => [new URL(each.src).pathname, ...box(each)]);
  await pause(300);
  const full = map._fullLayout, told = {};
  told.first = tell();
  told.zero = [full.xaxis.d2p(0), full.yaxis.d2p(0)];
  await window.Plotly.relayout(map, { "xaxis.range": [-1500, 1500], "yaxis.range": [-1500, 1500] });
  await pause(300);
  told.wide = tell();
  await window.Plotly.relayout(map, { "xaxis.range": [-5e9, 5e9], "yaxis.range": [-5e9, 5e9] });
  await pause(300);
  told.beyond = tell();
  await window.Plotly.relayout(map, { "xaxis.range": [-1500, 1500], "yaxis.range": [-1500, 1500] });
  await pause(300);
  told.again = tell();
  told.words = layer.querySelector("span").textContent;
  document.body.dataset.told = JSON.stringify(told);
})();
</script>
"""
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')


class Server(ThreadingHTTPServer):
    """Serves the same grey tile under every name, and keeps the names."""

    def __init__(self) -> None:
        _, data = cv2.imencode(".png", np.full((256, 256), 200, np.uint8))
        self.tile = data.tobytes()
        self.asked: list[str] = []
        super().__init__(("127.0.0.1", 0), Handler)


class Handler(BaseHTTPRequestHandler):
    """Answers with the tile."""

    server: Server

    def do_GET(self) -> None:
        self.server.asked.append(self.path)
        self.send_response(200)
        self.send_header("Content-Type", "image/png")
        self.send_header("Content-Length", str(len(self.server.tile)))
        self.end_headers()
        self.wfile.write(self.server.tile)

    def log_message(self, *words: object) -> None:
        """Say nothing."""


@pytest.fixture
def server() -> Iterator[Server]:
    with Server() as made:
        thread = threading.Thread(target=made.serve_forever)
        thread.start()
        yield made
        made.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("annotated") / "intersection.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(target), "--quiet"]) == 0
    return target


def make(annotated: Path, target: Path, *more: str) -> str:
    assert run_command_line(["report", str(annotated), "-o", str(target), "--quiet", *more]) == 0
    return target.read_text(encoding="utf-8")


def place(latitude_deg: float, longitude_deg: float, zoom: int) -> tuple[float, float]:
    """Column and row of a place among the tiles of a zoom, by the definition of Web Mercator."""
    latitude = math.radians(latitude_deg)
    column = (longitude_deg + 180.0) / 360.0 * 2**zoom
    row = (1.0 - math.log(math.tan(latitude) + 1.0 / math.cos(latitude)) / math.pi) / 2.0 * 2**zoom
    return column, row


def test_tiles_are_asked_of_the_server_alone_and_lie_where_the_map_is(
    annotated: Path, tmp_path: Path, server: Server
) -> None:
    address = f"http://127.0.0.1:{server.server_port}"
    whose = "© <b>them</b> & others"
    options = ("--tiles", f"{address}/map/{{z}}/{{x}}/{{y}}.png?key=1", "--tiles-attribution", whose)
    page = make(annotated, tmp_path / "r.html", *options)
    visited = visit(tmp_path / "r.html", tmp_path)  # as it is, with its policy
    assert visited.console == ()
    assert server.asked and all(re.fullmatch(r"/map/\d+/\d+/\d+\.png\?key=1", each) for each in server.asked)
    assert len(server.asked) == len(set(server.asked)) <= 64
    assert {each.split("/map/")[0] for each in visited.urls} == {address}
    assert "&lt;b&gt;them&lt;/b&gt;" in page and "<b>them" not in page

    (tmp_path / "p.html").write_text(POLICY.sub("", page).replace("</body>", f"{PLACES}</body>"), encoding="utf-8")
    (body,) = Elements(visit(tmp_path / "p.html", tmp_path).dom).of("body")
    told = json.loads(body["data-told"])
    assert told["words"] == whose
    assert told["beyond"] == [] and told["again"] == told["wide"]  # no tile fits where the earth is a point
    with Log.open(annotated) as log:
        origin = local_map_from_estimate_record(read_run_records(log)["estimate"])
    assert origin is not None
    zooms = []
    for shown in (told["first"], told["wide"]):
        (zoom,) = {int(path.split("/")[2]) for path, *_ in shown}
        zooms.append(zoom)
    column, row = place(origin.origin_lat_deg, origin.origin_lon_deg, zooms[0])
    name = f"/map/{zooms[0]}/{math.floor(column)}/{math.floor(row)}.png"
    left, top, width, height = {path: box for path, *box in told["first"]}[name]
    assert (told["zero"][0] - left) / width == pytest.approx(column % 1.0, abs=1.0 / width)
    assert (told["zero"][1] - top) / height == pytest.approx(row % 1.0, abs=1.0 / height)
    assert zooms[1] < zooms[0] <= 19
    for _, _, _, *size in told["wide"]:  # of the zoom whose tiles are shown the nearest to their 256 pixels
        assert all(256 / 1.5 < each < 256 * 1.5 for each in size)


def test_the_policy_lets_tiles_of_a_host_with_its_last_dot_through(
    annotated: Path, tmp_path: Path, server: Server
) -> None:
    template = f"http://localhost.:{server.server_port}/{{z}}/{{x}}/{{y}}.png"
    make(annotated, tmp_path / "r.html", "--tiles", template, "--tiles-attribution", "us")
    assert visit(tmp_path / "r.html", tmp_path).console == ()
    assert server.asked


def test_without_the_option_there_is_no_layer_and_the_policy_names_no_server(annotated: Path, tmp_path: Path) -> None:
    page = make(annotated, tmp_path / "r.html")
    assert "data-tiles" not in page
    policy = POLICY.findall(page)[0]
    assert "img-src data: blob:;" in policy and "http" not in policy.partition("content=")[2]


GOOD = "https://tiles.example.org/{z}/{x}/{y}.png"


def test_an_address_with_a_port_a_query_or_a_bare_number_is_taken() -> None:
    for template, origin in (
        (GOOD, "https://tiles.example.org"),
        ("http://[::1]:8080/t?z={z}&x={x}&y={y}", "http://[::1]:8080"),
        ("https://10.0.0.7/{z}/{y}/{x}", "https://10.0.0.7"),
        ("https://tiles.example.org./{z}/{x}/{y}", "https://tiles.example.org."),
    ):
        tiles = parse_tile_server(template, "us")
        assert tiles is not None and tiles.origin == origin
    assert parse_tile_server(None, None) is None


@pytest.mark.parametrize(
    ("template", "attribution", "why"),
    [
        (GOOD, None, "--tiles needs --tiles-attribution"),
        (GOOD, "  ", "--tiles needs --tiles-attribution"),
        (GOOD, "x" * 201, "in at most 200 characters"),
        (None, "us", "--tiles-attribution without --tiles"),
        ("javascript:alert(1)//{z}{x}{y}", "us", "http:// or https://"),
        ("file:///{z}/{x}/{y}.png", "us", "http:// or https://"),
        ("//host/{z}/{x}/{y}", "us", "http:// or https://"),
        ("https://host/{z}/{x}/{y}.png; script-src *", "us", "what no address holds"),
        ("https://host/{z}/{x}/{y}.png' onerror='x", "us", "what no address holds"),
        ("https://a.b\n/{z}/{x}/{y}", "us", "what no address holds"),
        ("https://me:secret@host/{z}/{x}/{y}", "us", "a name or a password"),
        ("https:///{z}/{x}/{y}", "us", "no host"),
        ("https://*/{z}/{x}/{y}", "us", "no host"),
        ("https://./{z}/{x}/{y}", "us", "no host"),
        ("https://my_tiles.example/{z}/{x}/{y}", "us", "an underscore"),
        ("https://a../{z}/{x}/{y}", "us", "no host"),
        ("https://host:99999/{z}/{x}/{y}", "us", "Port"),
        ("https://host/{z}/{x}", "us", "{z}, {x} and {y} must stand once"),
        ("https://{x}.host/{z}/{x}/{y}", "us", "no host"),
        ("https://{s}/{z}/{x}/{y}", "us", "no host"),
        ("https://host/{s}/{z}/{x}/{y}", "us", "only {z}, {x} and {y}"),
        ("https://host/{z}/{x}/{y}#a", "us", "{z}, {x} and {y} must stand once"),
        ("https://host/{z}/{x}/{y}/" + "a" * 500, "us", "more than 500 characters"),
    ],
)
def test_what_is_no_address_of_tiles_is_refused(template: str | None, attribution: str | None, why: str) -> None:
    with pytest.raises(UsageError) as refused:
        parse_tile_server(template, attribution)
    assert why in refused.value.what


def test_a_refused_address_is_a_usage_error_and_writes_nothing(annotated: Path, tmp_path: Path) -> None:
    arguments = [
        "report",
        str(annotated),
        "-o",
        str(tmp_path / "r.html"),
        "--tiles",
        "nowhere",
        "--tiles-attribution",
        "us",
    ]
    assert run_command_line(arguments) == EXIT_USAGE
    assert not (tmp_path / "r.html").exists()
