"""ASAM OSI: a multi-channel trace file with one `osi3.GroundTruth` for each state of the ego.

The rules: OSI 3.8.0, doc/architecture/trace_file_formats.adoc. A position is the centre of the box, velocity and
acceleration are in the axes of the map.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from cwcli.export.track_formats import Track, format_iso_time
from cwcli.logs.encoders.protobuf_encoder import encode_protobuf
from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.columns import FloatArray, Int64Array, OutputField, Repeated, Strings
from cwcli.signals.resample import interpolate_signal_at_times
from cwcli.signals.units import NS_PER_S

OSI_VERSION = (3, 8, 0)
"""Version of OSI whose messages are written."""
TRACE_TOPIC, TRACE_SCHEMA = "ground_truth", "osi3.GroundTruth"
"""Topic and schema of the only channel of a trace; chosen: OSI leaves the topic open."""
EGO_CONTENTS = ("ego", "ego-online")
"""Contents whose track is the host vehicle."""
DEFAULT_VEHICLE_LENGTH_AND_WIDTH_M = (4.5, 1.8)
"""Length and width of vehicles of unknown size, m; chosen: the same as in the criticality measures."""
ASSUMED_VEHICLE_HEIGHT_M = 1.5
"""Height of all vehicles, m; chosen: no message holds one."""
MAX_INTERPOLATED_TRACK_GAP_S = 1.0
"""Longest time between two states that is interpolated, s; chosen by hand."""
MOVING_OBJECT_TYPE_OTHER, MOVING_OBJECT_TYPE_VEHICLE, VEHICLE_CLASSIFICATION_TYPE_OTHER = 1, 2, 1
"""The values of MovingObject.Type and of VehicleClassification.Type that are used."""
GPS_EPOCH_NS = 315_964_800 * NS_PER_S
"""The GPS epoch (IS-GPS-200, 1980-01-06) as Unix time, ns; earlier stamps count from the start of a simulation."""


def encode_osi_mcap_trace(tracks: Sequence[Track]) -> bytes:
    """Encode all tracks at the times of the ego's states; without an ego, at those of all states.

    Other vehicles are interpolated between states that are at most a second apart. Ids that are no whole numbers are
    replaced by free numbers, with the original id as external reference.
    """
    host = next((track for track in tracks if track.what in EGO_CONTENTS), None)
    at_ns = np.unique(host.stamp_ns if host is not None else np.concatenate([track.stamp_ns for track in tracks]))
    n = len(at_ns)
    ids = _unique_numeric_ids(tracks)
    fields: dict[str, OutputField] = {
        **{
            f"version.version_{name}": np.full(n, part)
            for name, part in zip(_VERSION_NUMBER_NAMES, OSI_VERSION, strict=True)
        },
        "timestamp.seconds": at_ns // NS_PER_S,
        "timestamp.nanos": at_ns % NS_PER_S,
        "moving_object": _moving_objects_of_each_message(tracks, ids, at_ns),
    }
    if host is not None:
        fields["host_vehicle_id.value"] = np.full(n, ids[tracks.index(host)], np.uint64)
    schema = find_message_schema(TRACE_SCHEMA)
    with tempfile.TemporaryDirectory(prefix="cwcli-") as folder:
        path = Path(folder) / "trace.mcap"
        with LogWriter(path) as log:
            versions = _osi_and_protobuf_version_texts()
            key = "net.asam.osi.trace.channel"
            channel = log.add_channel(
                TRACE_TOPIC,
                "protobuf",
                log.add_schema(TRACE_SCHEMA, "protobuf", schema.data),
                {
                    f"{key}.osi_version": versions["min_osi_version"],
                    f"{key}.protobuf_version": versions["min_protobuf_version"],
                    f"{key}.description": "states by cwcli: " + ", ".join(dict.fromkeys(t.what for t in tracks)),
                },
            )
            log.write_messages(channel, at_ns, encode_protobuf(schema.descriptor, fields, n))
            zero = {"zero_time": format_iso_time(0)} if n and at_ns[0] >= GPS_EPOCH_NS else {}
            log.add_metadata("net.asam.osi.trace", {**versions, **zero, "description": "states estimated by cwcli"})
        return path.read_bytes()


_VERSION_NUMBER_NAMES = ("major", "minor", "patch")
"""Names of the parts of a version."""


def _osi_and_protobuf_version_texts() -> Mapping[str, str]:
    osi = ".".join(map(str, OSI_VERSION))
    found = re.match(r"\d+\.\d+\.\d+", version("protobuf"))
    protobuf = found.group() if found else "0.0.0"
    return {
        "version": osi,
        "min_osi_version": osi,
        "max_osi_version": osi,
        "min_protobuf_version": protobuf,
        "max_protobuf_version": protobuf,
    }


def _unique_numeric_ids(tracks: Sequence[Track]) -> list[int]:
    """Give each track a unique number: its own id where that is a number and still free."""
    own = [int(t.id) if t.id.isdecimal() and t.id == str(int(t.id)) and int(t.id) < 2**64 - 1 else None for t in tracks]
    used_ids: set[int] = set()
    ids: list[int | None] = []
    for number in own:
        ids.append(None if number in used_ids else number)
        if number is not None:
            used_ids.add(number)
    free = (number for number in range(len(tracks) + len(used_ids) + 1) if number not in used_ids)
    return [next(free) if number is None else number for number in ids]


def _moving_objects_of_each_message(tracks: Sequence[Track], ids: Sequence[int], at_ns: Int64Array) -> Repeated:
    """Make the moving objects of each message, in the order of the tracks."""
    parts = [_interpolate_states(track, at_ns) for track in tracks]
    is_known_by_part = [np.isfinite(part[:, :4]).all(axis=1) for part in parts]
    row = np.concatenate([np.flatnonzero(is_there) for is_there in is_known_by_part])
    owner = np.repeat(np.arange(len(tracks)), [np.count_nonzero(is_there) for is_there in is_known_by_part])
    state = np.concatenate([part[is_there] for part, is_there in zip(parts, is_known_by_part, strict=True)])
    order = np.lexsort((owner, row))
    row, owner, state = row[order], owner[order], state[order]
    x_m, y_m, speed, yaw_rad, accel, yaw_rate = state.T
    cosine, sine, aside = np.cos(yaw_rad), np.sin(yaw_rad), speed * yaw_rate
    sizes = np.array([_length_and_width_or_default_m(track) for track in tracks])[owner]
    nothing = np.zeros(len(owner))
    is_target = np.array([track.what == "targets" for track in tracks])[owner]
    triples = {
        "position": (x_m, y_m, np.full(len(owner), 0.5 * ASSUMED_VEHICLE_HEIGHT_M)),
        "velocity": (speed * cosine, speed * sine, nothing),
        "acceleration": (accel * cosine - aside * sine, accel * sine + aside * cosine, nothing),
    }
    angles = {"orientation": yaw_rad, "orientation_rate": yaw_rate}
    fields: dict[str, OutputField] = {
        "id.value": np.array(ids, np.uint64)[owner],
        **{f"base.{name}.{axis}": v for name, vs in triples.items() for axis, v in zip("xyz", vs, strict=True)},
        **{f"base.{name}.{axis}": nothing for name in angles for axis in ("roll", "pitch")},
        **{f"base.{name}.yaw": angle for name, angle in angles.items()},
        "base.dimension.length": sizes[:, 0],
        "base.dimension.width": sizes[:, 1],
        "base.dimension.height": np.full(len(owner), ASSUMED_VEHICLE_HEIGHT_M),
        "type": np.where(is_target, MOVING_OBJECT_TYPE_OTHER, MOVING_OBJECT_TYPE_VEHICLE),
        "vehicle_classification.type": np.full(len(owner), VEHICLE_CLASSIFICATION_TYPE_OTHER),
        "source_reference": Repeated(
            np.arange(len(owner) + 1, dtype=np.int64),
            {
                "reference": Strings(owner.astype(np.int32), tuple(track.id for track in tracks)),
                "type": Strings(np.zeros(len(owner), np.int32), ("net.cwcli",)),
            },
        ),
    }
    offsets = np.searchsorted(row, np.arange(len(at_ns) + 1)).astype(np.int64)
    return Repeated(offsets, fields)


def _length_and_width_or_default_m(track: Track) -> tuple[float, ...]:
    return tuple(
        size if size is not None and size > 0.0 else default
        for size, default in zip(track.size_m, DEFAULT_VEHICLE_LENGTH_AND_WIDTH_M, strict=True)
    )


def _interpolate_states(track: Track, at_ns: Int64Array) -> FloatArray:
    """Interpolate x, y, speed, heading, acceleration and yaw rate at n times, shape (n, 6); NaN outside the track."""
    nothing = np.zeros(len(track.stamp_ns))
    motion = [nothing if each is None else np.nan_to_num(each) for each in (track.accel_mps2, track.yaw_rate_radps)]
    lines = np.stack([track.x_m, track.y_m, track.speed_mps, *motion], axis=1)
    found = interpolate_signal_at_times(track.stamp_ns, lines, at_ns, max_gap_s=MAX_INTERPOLATED_TRACK_GAP_S)
    heading = interpolate_signal_at_times(
        track.stamp_ns, track.heading_rad, at_ns, max_gap_s=MAX_INTERPOLATED_TRACK_GAP_S, is_angle=True
    )
    return np.column_stack([found[:, :3], heading, found[:, 3:]])
