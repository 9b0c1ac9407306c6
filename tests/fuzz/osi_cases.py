"""Cases of the level `osi`: a mutated OSI trace (`osi3.*`) through a command.

Values, objects, whole fields, octets and times of a trace are changed; what protobuf can't parse is a case too.
"""

from __future__ import annotations

import io
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from math import cos, inf, nan, sin
from pathlib import Path
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_hostvehicledata_pb2 import HostVehicleData
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensordata_pb2 import SensorData
from osi3.osi_sensorview_pb2 import SensorView

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BUG, EXIT_CODES, EXIT_NOT_WRITTEN, CwcliError
from cwcli.logs.read.reader import Log
from tests.fuzz.file_cases import fast_folder
from tests.fuzz.mutate import Rng, mutate
from tests.osi_traces import Actor, along, fill_world
from tests.unit.logs_read.official import OfficialTopic, assert_same, read_officially

Message = tuple[str, int, Any]
"""Topic, log time in ns, protobuf message."""
N_INPUTS = 4
WITH_COMMAND = 0.2
"""The share of traces that go through a command; of the others, which are shorter, the values are compared."""
MAX_MESSAGES_TO_COMPARE = 6
MAX_MESSAGES = 60
STEP_NS = 100_000_000
HOST = Actor(3, along(0.0, 0.0, 0.3, 12.0, -1.0), size_m=(4.4, 1.8))
LEAD = Actor(8, along(25.0, 8.0, 0.3, 8.0))
WALKER = Actor(11, along(30.0, -5.0, 1.8, 1.2), size_m=(0.5, 0.5), kind=MovingObject.TYPE_PEDESTRIAN, rear_m=None)
UNEXPECTED = {EXIT_BUG, EXIT_NOT_WRITTEN}
COMMANDS = (
    *(("estimate", "LOG", "-o", "OUT"),) * 5,
    ("estimate", "LOG", "--tables", "--clock", "log"),
    ("estimate", "LOG", "-o", "OUT", "--sensor-model", "none"),
    ("track", "LOG", "-o", "OUT"),
    ("run", "LOG", "-o", "OUT"),
    ("info", "LOG", "--doctor", "--json"),
    ("evaluate", "LOG", "--json"),
)
FLOATS = (
    *(0.0, -0.0, 1e-300, 1e-150, 1e-9, 1.0, -1.0, 3.2, 360.0, 1e3, 1e6, 1e8, 1.1e8, 1e12, 1e150),
    *(1e200, 1e300, -1e300, inf, -inf, nan),
)
WHOLE = (0, 1, 2, 3, 8, 255, 2**31 - 1, 2**31, 2**32 - 1, 2**33, 2**53 + 1, 2**63 - 1, 2**63, 2**64 - 1, -1, -(2**31))
TIMES = (0, 1, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
FLOAT_KINDS = (FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT)


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate traces and check each; counts of inputs and of exit codes."""
    counts: Counter[str] = Counter()
    for _ in range(N_INPUTS):
        make = TRACES[int(rng.integers(len(TRACES)))]
        if rng.random() < WITH_COMMAND:
            data = mutated_trace(rng, make(int(rng.integers(2, MAX_MESSAGES))))
            check_trace(data, COMMANDS[int(rng.integers(len(COMMANDS)))], counts)
        else:
            check_values(mutated_trace(rng, make(int(rng.integers(2, MAX_MESSAGES_TO_COMPARE)))), counts)
    return dict(counts)


def check_values(data: bytes, counts: Counter[str]) -> None:
    """Compare all values of a trace with those of the official decoder of protobuf.

    Raises:
        AssertionError: A value is another one.
    """
    counts["inputs"] += 1
    official = read_officially(data)
    with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
        path = Path(folder) / "in.mcap"
        path.write_bytes(data)
        try:
            with Log.open(path) as log:
                found = {topic: log.columns(topic) for topic in official}
        except CwcliError as error:
            assert "\n" not in str(error)
            return
    counts["accepted"] += 1
    counts["compared"] += 1
    for topic, columns in found.items():
        assert_same(columns, with_signed_times(official[topic]), expect_paths=False)


def with_signed_times(said: OfficialTopic) -> OfficialTopic:
    """The same with times as cwcli holds them, in 64 bits with a sign: those beyond are below 0, and so come first."""
    logged, published = (
        [(t + 2**63) % 2**64 - 2**63 for t in each] for each in (said.log_time_ns, said.publish_time_ns)
    )
    order = sorted(range(len(logged)), key=logged.__getitem__)
    return replace(
        said,
        log_time_ns=[logged[k] for k in order],
        publish_time_ns=[published[k] for k in order],
        sequence=[said.sequence[k] for k in order],
        messages=[said.messages[k] for k in order],
    )


def check_trace(data: bytes, command: Sequence[str], counts: Counter[str]) -> None:
    """Run a command on a trace.

    Raises:
        AssertionError: The exit code is not documented, or is that of a bug.
    """
    counts["inputs"] += 1
    with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
        path, out = Path(folder) / "in.mcap", Path(folder) / "out.mcap"
        path.write_bytes(data)
        names = {"LOG": str(path), "OUT": str(out)}
        shown = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
        with redirect_stdout(shown), redirect_stderr(shown):
            code = run_command_line([names.get(each, each) for each in command])
        counts[f"exit {code}"] += 1
        counts["accepted"] += code == 0
        shown.flush()
        printed = shown.buffer.getvalue().decode()
        assert code in EXIT_CODES and code not in UNEXPECTED, f"{' '.join(command)}\n{printed}"
        assert out.exists() == (code == 0 and "OUT" in command), (code, printed)


def mutated_trace(rng: Rng, messages: list[Message]) -> bytes:
    """A trace with one to four changes, as an MCAP file."""
    for _ in range(int(rng.integers(1, 5))):
        _CHANGES[int(rng.integers(len(_CHANGES)))](rng, messages)
    payloads = [(topic, time_ns, message, message.SerializeToString()) for topic, time_ns, message in messages]
    if rng.random() < 0.2:
        for k in _some(rng, len(payloads)):
            topic, time_ns, message, payload = payloads[k]
            payloads[k] = topic, time_ns, message, mutate(rng, payload)
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start()
    channels: dict[str, int] = {}
    for topic, time_ns, message, payload in payloads:
        if topic not in channels:
            described = build_file_descriptor_set(type(message)).SerializeToString()
            schema = writer.register_schema(message.DESCRIPTOR.full_name, "protobuf", described)
            channels[topic] = writer.register_channel(topic, "protobuf", schema)
        writer.add_message(channels[topic], log_time=time_ns, publish_time=time_ns, data=payload)
    writer.finish()
    return stream.getvalue()


def _some(rng: Rng, n: int) -> range:
    """Numbers of some of n messages: one, all, those from one on, or every second."""
    if not n:
        return range(0)
    first = int(rng.integers(n))
    return (range(first, first + 1), range(n), range(first, n), range(first, n, 2))[int(rng.integers(4))]


def _leaves(message: Any, path: tuple[str | int, ...] = ()) -> list[tuple[Any, FieldDescriptor, tuple[str | int, ...]]]:
    """The numbers that are set in a message: the message that holds each, its field, and the path to it."""
    found = []
    for field, value in message.ListFields():
        here = (*path, field.name)
        if field.message_type is None:
            found.append((message, field, here))
            continue
        many = not hasattr(value, "ListFields")
        for k, inner in enumerate(value) if many else [(0, value)]:
            found += _leaves(inner, (*here, k) if many else here)
    return found


def _set_value(rng: Rng, messages: list[Message]) -> None:
    """One number, in some of the messages, becomes another, or is scaled."""
    if not messages:
        return
    leaves = _leaves(messages[int(rng.integers(len(messages)))][2])
    if not leaves:
        return
    path = leaves[int(rng.integers(len(leaves)))][2]
    is_scaled, pick = rng.random() < 0.3, rng.random()
    for k in _some(rng, len(messages)):
        for holder, field, here in _leaves(messages[k][2]):
            if here != path:
                continue
            is_float = field.cpp_type in FLOAT_KINDS
            values: Sequence[Any] = FLOATS if is_float else WHOLE
            value = values[int(pick * len(values))]
            if is_scaled and is_float:
                value = value * getattr(holder, field.name)
            try:
                setattr(holder, field.name, value)
            except (ValueError, TypeError):  # out of the range of an unsigned or an enumeration
                holder.ClearField(field.name)


def _clear(rng: Rng, messages: list[Message]) -> None:
    """One field is left out of some of the messages."""
    for k in _some(rng, len(messages)):
        leaves = _leaves(messages[k][2])
        if leaves:
            holder, field, _ = leaves[int(rng.integers(len(leaves)))]
            holder.ClearField(field.name)


def _change_objects(rng: Rng, messages: list[Message]) -> None:
    """Objects go or come twice in some of the messages."""
    drops = rng.random() < 0.5
    for k in _some(rng, len(messages)):
        world = messages[k][2]
        world = getattr(world, "global_ground_truth", world)
        objects = getattr(world, "moving_object", None)
        if objects is None or not len(objects):
            continue
        at = int(rng.integers(len(objects)))
        if drops:
            del objects[at]
        else:
            objects.add().CopyFrom(objects[at])


def _change_order(rng: Rng, messages: list[Message]) -> None:
    """Messages go, come twice or change their places."""
    if not messages:
        return
    k, change = int(rng.integers(len(messages))), int(rng.integers(3))
    if change == 0:
        del messages[k]
    elif change == 1:
        messages.insert(k, messages[k])
    else:
        messages.insert(int(rng.integers(len(messages))), messages.pop(k))


def _change_time(rng: Rng, messages: list[Message]) -> None:
    """Some log times are no times."""
    time_ns = TIMES[int(rng.integers(len(TIMES)))]
    for k in _some(rng, len(messages)):
        topic, _, message = messages[k]
        messages[k] = topic, time_ns, message


_CHANGES: tuple[Callable[[Rng, list[Message]], None], ...] = (
    *(_set_value,) * 5,
    _clear,
    _change_objects,
    _change_order,
    _change_time,
)


def _world(k: int) -> GroundTruth:
    message = GroundTruth()
    fill_world(message, (HOST, LEAD, WALKER), k / 10, stamp_ns=k * STEP_NS, host=HOST.id, at_m=(500.0, -200.0))
    return message


def _view(k: int) -> SensorView:
    message = SensorView()
    message.global_ground_truth.CopyFrom(_world(k))
    message.timestamp.CopyFrom(message.global_ground_truth.timestamp)
    message.host_vehicle_id.value = HOST.id
    return message


def _detection(k: int) -> SensorData:
    """What a sensor ahead of the host's rear axle detects of the lead vehicle."""
    message = SensorData()
    message.timestamp.seconds, message.timestamp.nanos = divmod(k * STEP_NS, 10**9)
    message.last_measurement_time.CopyFrom(message.timestamp)
    message.mounting_position.position.x, message.mounting_position.orientation.yaw = 2.0, 0.1
    x_m, y_m, yaw_rad, *_ = HOST.motion(k / 10)
    ahead_m, left_m = (there - here for there, here in zip(LEAD.motion(k / 10)[:2], (x_m, y_m), strict=True))
    base = message.moving_object.add().base
    base.position.x = ahead_m * cos(yaw_rad) + left_m * sin(yaw_rad)
    base.position.y = left_m * cos(yaw_rad) - ahead_m * sin(yaw_rad)
    base.dimension.length, base.dimension.width, base.orientation.yaw = 4.5, 1.8, 0.1
    message.moving_object[0].base_rmse.position.x = message.moving_object[0].base_rmse.position.y = 0.3
    message.sensor_view.add().CopyFrom(_view(k))
    return message


def _own(k: int) -> HostVehicleData:
    message = HostVehicleData()
    message.timestamp.seconds, message.timestamp.nanos = divmod(k * STEP_NS, 10**9)
    x_m, y_m, yaw_rad, speed_mps, _ = HOST.motion(k / 10)
    message.location.position.x, message.location.position.y = x_m, y_m
    message.location.orientation.yaw = yaw_rad
    message.location.velocity.x, message.location.velocity.y = speed_mps * cos(yaw_rad), speed_mps * sin(yaw_rad)
    message.location_rmse.position.x = message.location_rmse.position.y = 0.2
    message.location_rmse.orientation.yaw = 0.01
    message.vehicle_motion.velocity.x, message.vehicle_motion.orientation_rate.yaw = speed_mps, 0.001
    place = message.vehicle_localization.geodetic_position
    place.latitude, place.longitude, place.altitude = 48.0 + x_m * 9e-6, 11.0 + y_m * 1.3e-5, 500.0
    return message


def _trace(*channels: tuple[str, Callable[[int], Any]]) -> Callable[[int], list[Message]]:
    """A function that makes n messages of each channel, ten a second."""
    return lambda n: [(topic, k * STEP_NS, make(k)) for k in range(n) for topic, make in channels]


TRACES = (
    _trace(("ground_truth", _world)),
    _trace(("sensor_view", _view)),
    _trace(("sensor_data", _detection)),
    _trace(("host", _own)),
    _trace(("host", _own), ("ground_truth", _world)),
    _trace(("ground_truth", _world), ("sensor_data", _detection)),
)
