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
from cwcli.metrics.lane_scores import lanes_beside_ego, tusimple_score
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.findings import StudyPart
from cwcli.signals.leaf_fields import numbers_of_row, read_stamps
from cwcli.stages.lanes import LanesConfig, lanes
from cwcli.vision.methods import methods_without_model

LABELLED_FRAMES_FIGURE = "labelled frames"
"""The name under which the labelled frames are reported."""
MAX_LABEL_OFFSET_NS = 5_000_000
"""Labels and frames whose stamps differ by at most this, in ns, belong together. Chosen by hand; not fitted."""
SEARCH_SEED = 2011
"""Seed of the random searches, the year of zhang2011; any seed would do."""
SEARCHED_HEIGHT_SHARE = 150.0 / 240.0
"""Share of the image's height, from below, that the paper searches (section 1.1); only its rows are judged."""


def labelled_frames_part(path: Path) -> StudyPart:
    """Run all methods on a labelled log.

    Raises:
        MissingSignalError: The log has no labels.
        CwcliError: As the stage `lanes`.
    """
    with Log.open(path) as log:
        topic = find_first_lane_labels_topic(log)
        return StudyPart(
            tuple(each for key in methods_without_model() for each in _measure_shares_found(key, log, topic))
        )


def find_first_lane_labels_topic(log: Log) -> str:
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


def _measure_shares_found(key: str, log: Log, topic: str) -> list[MeasuredNumber]:
    """Measure which labelled boundaries next to the car a method finds, and the frames with all of them found."""
    rows = read_lanes(
        log.with_channels(lanes(log, LanesConfig(method=key, seed=SEARCH_SEED)).channels).columns(LANES.topic)
    )
    labels = log.columns(topic)
    label_ns, has_stamp = read_stamps(labels)
    label_ns = np.where(has_stamp, label_ns, labels.log_time_ns)
    n_boundaries = n_found = n_frames = n_right = 0
    for label, stamp_ns in enumerate(label_ns.tolist()):
        [near] = np.nonzero(np.abs(rows.stamp_ns - stamp_ns) <= MAX_LABEL_OFFSET_NS)
        heights, flat = numbers_of_row(labels.fields["h_samples"], label), numbers_of_row(labels.fields["lanes"], label)
        if not len(near) or not len(heights) or len(flat) % len(heights):
            continue
        row = int(near[0])
        width_px, height_px = rows.image_size[row].tolist()
        ego_lanes = lanes_beside_ego(flat.reshape(-1, len(heights)), heights, width_px, height_px)
        lines = [
            np.interp(heights, line[::-1, 1], line[::-1, 0], left=np.nan, right=np.nan)
            for line in (
                each[np.argsort(-each[:, 1])] for each in rows.boundaries_in_pixels(row, (width_px, height_px))
            )
            if len(line)
        ]
        is_searched = heights >= height_px * (1.0 - SEARCHED_HEIGHT_SHARE)
        right = [
            tusimple_score([line[is_searched] for line in lines], [truth[is_searched]], heights[is_searched])
            for truth in ego_lanes
        ]
        n_boundaries += len(right)
        n_found += sum(score.false_negative == 0.0 for score in right)
        n_frames += bool(right)
        n_right += bool(right) and all(score.false_negative == 0.0 for score in right)
    return [
        _share_with_interval(f"{key}: boundaries beside the car that are found", n_found, n_boundaries),
        _share_with_interval(f"{key}: frames with every boundary beside the car found", n_right, n_frames),
    ]


def _share_with_interval(what: str, n_right: int, n: int) -> MeasuredNumber:
    """Return a share in per cent with its interval."""
    low, high = proportion_interval(n_right, n) if n else (np.nan, np.nan)
    return MeasuredNumber(LABELLED_FRAMES_FIGURE, what, 100.0 * n_right / n if n else np.nan, 100.0 * low, 100.0 * high)
