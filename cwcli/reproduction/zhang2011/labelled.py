"""The paper's method on real frames that somebody labelled: a log with a camera and labels in TuSimple's form.

The labelled frames of that benchmark are unrelated and far apart in time, so each is searched by itself, in the paper's
first phase. The paper's own frames are not to be had.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cwcli.channels.lanes import read_lanes
from cwcli.channels.published import LANES
from cwcli.errors import MissingSignalError
from cwcli.logs.read.reader import Log
from cwcli.metrics.intervals import proportion_interval
from cwcli.metrics.lane_scores import ego_lanes, tusimple_score
from cwcli.reproduction.classes import Measured
from cwcli.reproduction.findings import Part
from cwcli.signals.leaf_fields import row_of, stamps
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.methods import ready_methods

FIGURE = "labelled frames"
"""The name under which the labelled frames are reported."""
MATCH_NS = 5_000_000
"""Labels and frames whose stamps differ by at most this, in ns, belong together. Chosen by hand; not fitted."""
SEED = 2011
"""Seed of the random searches, the year of zhang2011; any seed would do."""
SEARCHED_SHARE = 150.0 / 240.0
"""Share of the image's height, from below, that the paper searches (section 1.1); only its rows are judged."""


def labelled_part(path: Path) -> Part:
    """Run all methods on a labelled log.

    Args:
        path: Of the log.

    Raises:
        MissingSignalError: The log has no labels.
        CwcliError: As the stage `lanes`.
    """
    with Log.open(path) as log:
        topic = labels_of(log)
        return Part(tuple(each for key in ready_methods() for each in _shares(key, log, topic)))


def labels_of(log: Log) -> str:
    """Find the first topic with labels in TuSimple's form.

    Raises:
        MissingSignalError: There is none.
    """
    for channel in log.channels:
        if channel.message_encoding == "json" and {"h_samples", "lanes"} <= set(log.columns(channel.topic).fields):
            return channel.topic
    raise MissingSignalError(
        "the log has no labels of lanes", hint="they are a JSON channel with h_samples and lanes, in TuSimple's form"
    )


def _shares(key: str, log: Log, topic: str) -> list[Measured]:
    """Measure which labelled boundaries next to the car a method finds, and the frames with all of them found."""
    rows = read_lanes(log.with_channels(lanes(log, LanesConfig(method=key, seed=SEED)).channels).columns(LANES.topic))
    labels = log.columns(topic)
    label_ns, has_stamp = stamps(labels)
    label_ns = np.where(has_stamp, label_ns, labels.log_time_ns)
    n_boundaries = n_found = n_frames = n_right = 0
    for label, stamp_ns in enumerate(label_ns.tolist()):
        [near] = np.nonzero(np.abs(rows.stamp_ns - stamp_ns) <= MATCH_NS)
        heights, flat = row_of(labels.fields["h_samples"], label), row_of(labels.fields["lanes"], label)
        if not len(near) or not len(heights) or len(flat) % len(heights):
            continue
        row = int(near[0])
        width_px, height_px = rows.image_size[row].tolist()
        beside = ego_lanes(flat.reshape(-1, len(heights)), heights, width_px, height_px)
        lines = [
            np.interp(heights, line[::-1, 1], line[::-1, 0], left=np.nan, right=np.nan)
            for line in (each[np.argsort(-each[:, 1])] for each in rows.lines(row, (width_px, height_px)))
            if len(line)
        ]
        is_searched = heights >= height_px * (1.0 - SEARCHED_SHARE)
        right = [
            tusimple_score([line[is_searched] for line in lines], [truth[is_searched]], heights[is_searched])
            for truth in beside
        ]
        n_boundaries += len(right)
        n_found += sum(score.false_negative == 0.0 for score in right)
        n_frames += bool(right)
        n_right += bool(right) and all(score.false_negative == 0.0 for score in right)
    return [
        _share(f"{key}: boundaries beside the car that are found", n_found, n_boundaries),
        _share(f"{key}: frames with every boundary beside the car found", n_right, n_frames),
    ]


def _share(what: str, n_right: int, n: int) -> Measured:
    """Return a share in per cent with its interval."""
    low, high = proportion_interval(n_right, n) if n else (np.nan, np.nan)
    return Measured(FIGURE, what, 100.0 * n_right / n if n else np.nan, 100.0 * low, 100.0 * high)
