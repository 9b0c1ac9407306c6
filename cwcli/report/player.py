"""The camera's frames over the whole log, small and few: the page shows the one that belongs to the marked moment."""

from __future__ import annotations

from collections.abc import Iterable

from cwcli.digest.drive import Drive
from cwcli.report.frames import Thumbnail
from cwcli.report.views import Player
from cwcli.signals.units import NS_PER_S

MAX_FRAMES_TEXT_BYTES = 1_300_000
"""The greatest size of a log's frames as text, in bytes; more are thinned out. Chosen by hand; not fitted."""


def evenly_spaced_stamps_ns(drive: Drive, n: int) -> list[int]:
    """Return n stamps, evenly over the log, at which frames are wanted; [] without a camera."""
    if not drive.camera_topic or n < 1:
        return []
    span = drive.end_ns - drive.start_ns
    return [drive.start_ns + span * k // max(n - 1, 1) for k in range(n)]


def build_picture_player(drive: Drive, pictures: Iterable[Thumbnail]) -> Player | None:
    """Build the player of the frames in order of time, thinned out to fit; None of fewer than two."""
    unique = {picture.stamp_ns: picture for picture in pictures}
    shown = [unique[stamp] for stamp in sorted(unique)]
    while len(shown) > 2 and sum(len(each.data_uri) for each in shown) > MAX_FRAMES_TEXT_BYTES:
        shown = shown[::2]
    if len(shown) < 2:
        return None
    return Player(
        first=shown[0].data_uri,
        width_px=shown[0].width_px,
        height_px=shown[0].height_px,
        start_s=round(_seconds_since_start(drive, min(shown[0].stamp_ns, drive.start_ns)), 2),
        end_s=round(_seconds_since_start(drive, max(shown[-1].stamp_ns, drive.end_ns)), 2),
        moments=tuple(
            (round(_seconds_since_start(drive, each.stamp_ns), 3), each.data_uri.partition(",")[2]) for each in shown
        ),
    )


def _seconds_since_start(drive: Drive, stamp_ns: int) -> float:
    """Return the seconds since the log began."""
    return (stamp_ns - drive.start_ns) / NS_PER_S
