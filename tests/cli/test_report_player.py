"""The camera frame at the marked moment: by pointing, by the slider and the keyboard; none without a camera."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path

import pytest

from cwcli.cli.main import run_command_line
from cwcli.report import section
from tests.cli.browser import Elements, visit
from tests.cli.conftest import SAMPLES
from tests.cli.test_report import with_camera

POINT = """
<script>
(async () => {
  const pause = (ms) => new Promise((done) => setTimeout(done, ms));
  while (document.documentElement.dataset.plots !== "drawn") { await pause(50); }
  const told = [], screen = document.querySelector(".player .screen"), image = screen.querySelector("img");
  const slider = document.querySelector(".player input"), motion = document.querySelector(".plot.motion");
  const frames = JSON.parse(document.querySelector(".player script").textContent);
  const tell = async () => {
    await pause(50);
    const row = frames.findIndex((each) => image.src.endsWith("," + each[1]));
    told.push([row, Number(document.querySelector(".log").dataset.at), image.naturalWidth, Number(slider.value),
      screen.classList.contains("corner")]);
  };
  const point = (at) => {
    const full = motion._fullLayout, left = motion.getBoundingClientRect().left + full._size.l;
    const clientX = Math.ceil(left + full.xaxis.d2p(at)); // a mouse points at whole pixels
    motion.dispatchEvent(new MouseEvent("mousemove", { clientX }));
    return [full.xaxis.p2d(clientX - left), full.xaxis.p2d(1) - full.xaxis.p2d(0)];
  };
  motion.scrollIntoView();
  told.push(point(5.04));
  await tell();
  motion.dispatchEvent(new MouseEvent("mouseleave"));
  told.push(screen.classList.contains("corner"));
  slider.focus();
  slider.value = 2.31;
  slider.dispatchEvent(new Event("input"));
  await tell();
  told.push([...document.querySelectorAll(".cursor.at")].filter((each) => each.style.display === "block").length);
  point(0.0);
  await tell();
  document.body.dataset.told = JSON.stringify(told);
  document.body.dataset.focused = document.activeElement === slider;
})();
</script>
"""
HALF_STEP_S = 0.005 + 1e-9
"""Of the slider."""
POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The intersection with a camera at 10 Hz from the log's start."""
    folder = tmp_path_factory.mktemp("seen")
    assert (
        run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(folder / "annotated.mcap"), "--quiet"])
        == 0
    )
    with_camera(folder / "annotated.mcap", folder / "seen.mcap")
    return folder / "seen.mcap"


def frames_of(page: str) -> list[list[float]]:
    (listed,) = re.findall(r'<figure class="player">.*?<script type="text/plain">(.*?)</script>', page, re.DOTALL)
    found: list[list[float]] = json.loads(listed)
    return found


def test_pointing_and_the_slider_show_the_last_frame_before_the_moment(seen: Path, tmp_path: Path) -> None:
    assert run_command_line(["report", str(seen), "-o", str(tmp_path / "r.html"), "--quiet"]) == 0
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    times = [at for at, _ in frames_of(page)]
    assert times == sorted(times) and 60 <= len(times) <= 100  # a hundred moments, of frames 0.1 s apart
    assert max(b - a for a, b in itertools.pairwise(times)) <= 0.2 + 1e-6
    (tmp_path / "p.html").write_text(POLICY.sub("", page).replace("</body>", f"{POINT}</body>"), encoding="utf-8")
    (body,) = Elements(visit(tmp_path / "p.html", tmp_path, size="1280,700").dom).of("body")
    (aimed_s, pixel_s), pointed, is_left_in_corner, slid, n_lines, at_start = json.loads(body["data-told"])

    def before(at: float) -> int:
        return max(k for k, each in enumerate(times) if each <= at)

    assert 5.04 <= aimed_s < 5.04 + pixel_s
    assert pointed[0] == before(aimed_s) and pointed[2] == 320 and pointed[4] is True
    assert [pointed[1], pointed[3]] == pytest.approx([aimed_s] * 2, abs=HALF_STEP_S)
    assert is_left_in_corner is False
    assert slid[0] == before(2.31) and slid[1] == 2.31 and slid[4] is False
    assert n_lines >= 2  # the slider marks the moment in the figures, too
    assert at_start[0] == 0
    assert body["data-focused"] == "true"


def test_frames_are_thinned_out_to_fit(seen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run_command_line(["report", str(seen), "-o", str(tmp_path / "r.html"), "--quiet"]) == 0
    all_frames = frames_of((tmp_path / "r.html").read_text(encoding="utf-8"))
    size = sum(len(str(picture)) for _, picture in all_frames)
    monkeypatch.setattr(section, "MAX_FRAMES_TEXT_BYTES", size // 3)
    assert run_command_line(["report", str(seen), "-o", str(tmp_path / "r.html"), "--quiet", "--force"]) == 0
    fewer = frames_of((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert fewer == all_frames[::4]
    assert sum(len(str(picture)) for _, picture in fewer) <= size // 3


def test_a_log_without_a_camera_has_no_place_for_its_frames(tmp_path: Path) -> None:
    annotated = tmp_path / "annotated.mcap"
    assert run_command_line(["run", str(SAMPLES / "intersection.mcap"), "-o", str(annotated), "--quiet"]) == 0
    assert run_command_line(["report", str(annotated), "-o", str(tmp_path / "r.html"), "--quiet"]) == 0
    assert 'class="player"' not in (tmp_path / "r.html").read_text(encoding="utf-8")
