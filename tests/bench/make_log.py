"""Ten-minute logs for benchmarks: JPEG 640x480 10 Hz, IMU 100 Hz, GNSS 10 Hz, 20 remote cars at 10 Hz.

    python tests/bench/make_log.py /tmp/bench --seconds 600 --images

writes cdr.mcap, protobuf.mcap and json.mcap: the same numbers in the three encodings. Images are random bytes of a
JPEG's size, because nothing here decodes them, and because real ones can't be compressed either. The remote cars send
J2735 BSM (`j2735_v2x_msgs/BSM` in CDR, the standard's names in JSON, and a made-up message with the same fields in
protobuf, for which no standard schema exists; likewise the IMU).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass

from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.logs.write.writer import LogWriter
from tests.bench.ros_messages import BSM_TEXT, FIX_TEXT, IMAGE_TEXT, IMU_TEXT

T0_NS = 1_700_000_000_000_000_000
NS_PER_S = 1_000_000_000
N_CARS = 20
IMU_HZ, GNSS_HZ, CAR_HZ, CAMERA_HZ = 100, 10, 10, 10
JPEG_BYTES = 40_000
IMU_TOPIC, GNSS_TOPIC, BSM_TOPIC, CAMERA_TOPIC = "/imu/data", "/gps/fix", "/v2x/bsm", "/camera/image"


@dataclass(frozen=True)
class Drive:
    """The numbers behind a log; one row a message, in log-time order.

    Attributes:
        imu_ns, gnss_ns, car_ns, camera_ns: Log times; stamps are 5 ms earlier.
        accel, gyro: Shape (n, 3).
        position: Shape (n, 3): latitude, longitude, altitude.
        car: Shape (n,): which car.
        bsm: Columns by J2735 name, raw integers.
    """

    imu_ns: npt.NDArray[np.int64]
    gnss_ns: npt.NDArray[np.int64]
    car_ns: npt.NDArray[np.int64]
    camera_ns: npt.NDArray[np.int64]
    accel: npt.NDArray[np.float64]
    gyro: npt.NDArray[np.float64]
    position: npt.NDArray[np.float64]
    car: npt.NDArray[np.int64]
    bsm: dict[str, npt.NDArray[np.int64]]


def drive(seconds: int, seed: int = 1) -> Drive:
    """A drive at constant speed with noise on everything."""
    rng = np.random.default_rng(seed)

    def times(rate_hz: int) -> npt.NDArray[np.int64]:
        return T0_NS + np.arange(seconds * rate_hz, dtype=np.int64) * (NS_PER_S // rate_hz) + 5_000_000

    imu_ns, gnss_ns = times(IMU_HZ), times(GNSS_HZ)
    car = np.tile(np.arange(N_CARS), seconds * CAR_HZ)
    car_ns = np.repeat(times(CAR_HZ), N_CARS) + car * 1_000_003
    t_s = (gnss_ns - T0_NS) / NS_PER_S
    car_s = (car_ns - T0_NS) / NS_PER_S
    n = len(car_ns)
    bsm = {
        "msgCnt": np.arange(n) // N_CARS % 128,
        "secMark": ((car_ns // 1_000_000) % 60_000),
        "lat": (490_000_000 + 900 * car + 90 * car_s + rng.normal(0, 20, n)).astype(np.int64),
        "long": (80_000_000 + 400 * car + rng.normal(0, 20, n)).astype(np.int64),
        "elev": (1100 + rng.normal(0, 5, n)).astype(np.int64),
        "speed": (500 + rng.normal(0, 10, n)).astype(np.int64),
        "heading": rng.integers(0, 80, n),
        "accelLong": rng.integers(-100, 100, n),
        "accelLat": rng.integers(-50, 50, n),
        "yaw": rng.integers(-100, 100, n),
    }
    return Drive(
        imu_ns,
        gnss_ns,
        car_ns,
        times(CAMERA_HZ),
        rng.normal([0, 0, 9.81], 0.3, (len(imu_ns), 3)),
        rng.normal(0, 0.01, (len(imu_ns), 3)),
        np.column_stack([49 + 9e-6 * t_s, np.full(len(t_s), 8.0), np.full(len(t_s), 110.0)])
        + rng.normal(0, 1e-6, (len(t_s), 3)),
        car,
        bsm,
    )


def write_cdr(path: Path, data: Drive, *, images: bool) -> None:
    """`sensor_msgs` and `j2735_v2x_msgs` in CDR."""
    imu = _records(
        data.imu_ns,
        "imu_link",
        [
            ("orientation", "<f8", 4),
            ("orientation_covariance", "<f8", 9),
            ("gyro", "<f8", 3),
            ("gyro_covariance", "<f8", 9),
            ("accel", "<f8", 3),
            ("accel_covariance", "<f8", 9),
        ],
    )
    imu["orientation_covariance"][:, 0] = -1
    imu["gyro"], imu["accel"] = data.gyro, data.accel
    imu["gyro_covariance"][:, ::4], imu["accel_covariance"][:, ::4] = 1e-4, 0.09
    fix = _records(
        data.gnss_ns,
        "gps",
        [
            ("status", "i1", 1),
            ("service", "<u2", 1),
            ("position", "<f8", 3),
            ("covariance", "<f8", 9),
            ("type", "u1", 1),
        ],
    )
    fix["position"], fix["type"] = data.position, 2
    fix["covariance"][:, ::4] = 0.25
    names = {"msg_count": "msgCnt", "sec_mark": "secMark", "latitude": "lat", "longitude": "long", "elev": "elev"}
    names |= {"speed": "speed", "heading": "heading", "accel_long": "accelLong", "accel_lat": "accelLat", "yaw": "yaw"}
    bsm = _records(
        data.car_ns,
        "",
        [
            ("msg_count", "u1", 1), ("id_length", "<u4", 1), ("id", "u1", 4), ("sec_mark", "<u2", 1),
            ("latitude", "<i4", 1), ("longitude", "<i4", 1), ("elev", "<i4", 1), ("semi", "u1", 2),
            ("orientation", "<u2", 1), ("transmission", "u1", 1), ("speed", "<u2", 1), ("heading", "<u2", 1),
            ("angle", "i1", 1), ("accel_long", "<i2", 1), ("accel_lat", "<i2", 1), ("vertical", "i1", 1),
            ("yaw", "<i2", 1), ("width", "<u2", 1), ("length", "<u2", 1),
        ],
    )  # fmt: skip
    for name, source in names.items():
        bsm[name] = data.bsm[source]
    bsm["id_length"], bsm["id"][:, 3], bsm["semi"] = 4, data.car, 40
    bsm["transmission"], bsm["angle"], bsm["vertical"], bsm["width"], bsm["length"] = 2, 127, -127, 200, 500
    with LogWriter(path, profile="ros2", force=True) as log:
        for topic, name, text, times, records in (
            (IMU_TOPIC, "sensor_msgs/msg/Imu", IMU_TEXT, data.imu_ns, imu),
            (GNSS_TOPIC, "sensor_msgs/msg/NavSatFix", FIX_TEXT, data.gnss_ns, fix),
            (BSM_TOPIC, "j2735_v2x_msgs/msg/BSM", BSM_TEXT, data.car_ns, bsm),
        ):
            channel = log.add_channel(topic, "cdr", log.add_schema(name, "ros2msg", text.encode()))
            log.write_messages(channel, times, _split(records))
        if images:
            schema = log.add_schema("sensor_msgs/msg/CompressedImage", "ros2msg", IMAGE_TEXT.encode())
            head = _records(data.camera_ns, "cam", [("format_length", "<u4", 1), ("format", "u1", 5), ("n", "<u4", 1)])
            head["format_length"], head["format"], head["n"] = 5, list(b"jpeg\0"), JPEG_BYTES
            frames = [start + image for start, image in zip(_split(head), _images(len(head)), strict=True)]
            log.write_messages(log.add_channel(CAMERA_TOPIC, "cdr", schema), data.camera_ns, frames)


def write_protobuf(path: Path, data: Drive, *, images: bool) -> None:
    """`foxglove` messages, and made-up ones for the IMU and the BSM."""
    pool, schema_data = bench_schemas()
    make = {name: GetMessageClass(pool.FindMessageTypeByName(f"bench.{name}")) for name in ("Imu", "Bsm")}
    fix_class = GetMessageClass(find_message_schema("foxglove.LocationFix").descriptor)
    diagonal = [0.25, 0, 0, 0, 0.25, 0, 0, 0, 0.25]

    def imu() -> Iterator[bytes]:
        for ns, accel, gyro in zip(data.imu_ns.tolist(), data.accel.tolist(), data.gyro.tolist(), strict=True):
            message = make["Imu"](frame_id="imu_link", accel_covariance=diagonal, gyro_covariance=diagonal)
            message.timestamp.seconds, message.timestamp.nanos = divmod(ns - 5_000_000, NS_PER_S)
            message.linear_acceleration.x, message.linear_acceleration.y, message.linear_acceleration.z = accel
            message.angular_velocity.x, message.angular_velocity.y, message.angular_velocity.z = gyro
            yield message.SerializeToString()

    def fix() -> Iterator[bytes]:
        for ns, (latitude, longitude, altitude) in zip(data.gnss_ns.tolist(), data.position.tolist(), strict=True):
            message = fix_class(latitude=latitude, longitude=longitude, altitude=altitude, frame_id="gps")
            message.timestamp.seconds, message.timestamp.nanos = divmod(ns - 5_000_000, NS_PER_S)
            message.position_covariance.extend(diagonal)
            message.position_covariance_type = 2
            yield message.SerializeToString()

    def bsm() -> Iterator[bytes]:
        rows = zip(*(column.tolist() for column in data.bsm.values()), strict=True)
        for ns, car, row in zip(data.car_ns.tolist(), data.car.tolist(), rows, strict=True):
            message = make["Bsm"](id=f"{car:08x}", **dict(zip(data.bsm, row, strict=True)))
            message.timestamp.seconds, message.timestamp.nanos = divmod(ns - 5_000_000, NS_PER_S)
            yield message.SerializeToString()

    standard = find_message_schema("foxglove.LocationFix")
    with LogWriter(path, force=True) as log:
        for topic, name, schema, times, messages in (
            (IMU_TOPIC, "bench.Imu", schema_data, data.imu_ns, imu),
            (GNSS_TOPIC, standard.name, standard.data, data.gnss_ns, fix),
            (BSM_TOPIC, "bench.Bsm", schema_data, data.car_ns, bsm),
        ):
            channel = log.add_channel(topic, "protobuf", log.add_schema(name, "protobuf", schema))
            log.write_messages(channel, times, list(messages()))
        if images:
            _write_foxglove_images(log, data)


def write_json(path: Path, data: Drive, *, images: bool) -> None:
    """ROS field names for IMU and GNSS, J2735 names for the BSM; the images stay protobuf, as recorders do it."""

    def header(ns: int, frame_id: str) -> dict[str, Any]:
        seconds, nanoseconds = divmod(ns - 5_000_000, NS_PER_S)
        return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}

    def vector(values: list[float]) -> dict[str, float]:
        return dict(zip("xyz", values, strict=True))

    diagonal = [0.25, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 0.25]
    gyro_covariance, accel_covariance = (np.diag([variance] * 3).ravel().tolist() for variance in (1e-4, 0.09))

    def imu() -> Iterator[dict[str, Any]]:
        for ns, accel, gyro in zip(data.imu_ns.tolist(), data.accel.tolist(), data.gyro.tolist(), strict=True):
            yield {
                "header": header(ns, "imu_link"),
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                "orientation_covariance": [-1.0, *[0.0] * 8],
                "angular_velocity": vector(gyro),
                "angular_velocity_covariance": gyro_covariance,
                "linear_acceleration": vector(accel),
                "linear_acceleration_covariance": accel_covariance,
            }

    def fix() -> Iterator[dict[str, Any]]:
        for ns, (latitude, longitude, altitude) in zip(data.gnss_ns.tolist(), data.position.tolist(), strict=True):
            yield {
                "timestamp": {"sec": (ns - 5_000_000) // NS_PER_S, "nsec": (ns - 5_000_000) % NS_PER_S},
                "frame_id": "gps",
                "latitude": latitude,
                "longitude": longitude,
                "altitude": altitude,
                "position_covariance": diagonal,
                "position_covariance_type": 2,
            }

    def bsm() -> Iterator[dict[str, Any]]:
        rows = zip(*(column.tolist() for column in data.bsm.values()), strict=True)
        for car, values in zip(data.car.tolist(), rows, strict=True):
            row = dict(zip(data.bsm, values, strict=True))
            core = {
                "msgCnt": row["msgCnt"], "id": f"{car:08x}", "secMark": row["secMark"], "lat": row["lat"],
                "long": row["long"], "elev": row["elev"],
                "accuracy": {"semiMajor": 40, "semiMinor": 40, "orientation": 0},
                "transmission": "forwardGears", "speed": row["speed"], "heading": row["heading"], "angle": 127,
                "accelSet": {"long": row["accelLong"], "lat": row["accelLat"], "vert": -127, "yaw": row["yaw"]},
                "brakes": {
                    "wheelBrakes": "00000", "traction": "unavailable", "abs": "unavailable", "scs": "unavailable",
                    "brakeBoost": "unavailable", "auxBrakes": "unavailable",
                },
                "size": {"width": 200, "length": 500},
            }  # fmt: skip
            yield {"coreData": core}

    sources: tuple[tuple[str, str, npt.NDArray[np.int64], Callable[[], Iterator[dict[str, Any]]]], ...] = (
        (IMU_TOPIC, "sensor_msgs/Imu", data.imu_ns, imu),
        (GNSS_TOPIC, "foxglove.LocationFix", data.gnss_ns, fix),
        (BSM_TOPIC, "BasicSafetyMessage", data.car_ns, bsm),
    )
    with LogWriter(path, force=True) as log:
        for topic, name, times, messages in sources:
            channel = log.add_channel(topic, "json", log.add_schema(name, "jsonschema", b'{"type": "object"}'))
            log.write_messages(channel, times, [json.dumps(each).encode() for each in messages()])
        if images:
            _write_foxglove_images(log, data)


def bench_schemas() -> tuple[DescriptorPool, bytes]:
    """`bench.Imu` and `bench.Bsm`."""
    number, integer, text, nested = 1, 5, 9, 11
    file = FileDescriptorProto(name="bench.proto", package="bench", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    covariances = ("gyro_covariance", "accel_covariance")
    vectors = (("angular_velocity", nested, ".bench.Vector3"), ("linear_acceleration", nested, ".bench.Vector3"))
    stamp = ("timestamp", nested, ".google.protobuf.Timestamp")
    for name, fields in {
        "Vector3": [(axis, number, "") for axis in "xyz"],
        "Imu": [stamp, ("frame_id", text, ""), *vectors, *((each, number, "") for each in covariances)],
        "Bsm": [stamp, ("id", text, ""), *((each, integer, "") for each in drive(1).bsm)],
    }.items():
        message = file.message_type.add(name=name)
        for k, (field_name, kind, type_name) in enumerate(fields, 1):
            is_repeated = field_name in covariances
            label = FieldDescriptorProto.LABEL_REPEATED if is_repeated else FieldDescriptorProto.LABEL_OPTIONAL
            field = message.field.add(name=field_name, number=k, type=kind, label=label)
            if type_name:
                field.type_name = type_name
    from google.protobuf import timestamp_pb2

    descriptor_set = FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(descriptor_set.file.add())
    descriptor_set.file.append(file)
    pool = DescriptorPool()
    for each in descriptor_set.file:
        pool.Add(each)
    return pool, descriptor_set.SerializeToString()


def _write_foxglove_images(log: LogWriter, data: Drive) -> None:
    schema = find_message_schema("foxglove.CompressedImage")
    image_class = GetMessageClass(schema.descriptor)
    channel = log.add_channel(CAMERA_TOPIC, "protobuf", log.add_schema(schema.name, "protobuf", schema.data))
    messages = []
    for ns, image in zip(data.camera_ns.tolist(), _images(len(data.camera_ns)), strict=True):
        message = image_class(frame_id="cam", format="jpeg", data=image)
        message.timestamp.seconds, message.timestamp.nanos = divmod(ns - 5_000_000, NS_PER_S)
        messages.append(message.SerializeToString())
    log.write_messages(channel, data.camera_ns, messages)


def _images(n: int) -> Iterator[bytes]:
    rng = np.random.default_rng(2)
    for _ in range(n):
        yield b"\xff\xd8" + rng.bytes(JPEG_BYTES - 4) + b"\xff\xd9"


def _records(log_time_ns: npt.NDArray[np.int64], frame_id: str, members: list[tuple[str, str, int]]) -> Any:
    """Zeroed CDR messages with a ROS header: each member aligned to its size from behind the encapsulation header."""
    frame = frame_id.encode() + b"\0"
    text = ("frame", f"V{len(frame)}", 1)
    names, formats, offsets = ["cdr"], ["V4"], [0]
    at = 0
    for name, code, count in [("sec", "<i4", 1), ("nanosec", "<u4", 1), ("frame_length", "<u4", 1), text, *members]:
        size = np.dtype(code).itemsize
        at += -at % (1 if code.startswith("V") else size)
        names.append(name)
        formats.append(code if count == 1 else f"({count},){code}")
        offsets.append(4 + at)
        at += size * count
    layout = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 4 + at})
    records = np.zeros(len(log_time_ns), layout)
    records["cdr"], records["frame"] = np.void(b"\0\1\0\0"), np.void(frame)
    records["sec"], records["nanosec"] = np.divmod(log_time_ns - 5_000_000, NS_PER_S)
    records["frame_length"] = len(frame)
    return records


def _split(records: Any) -> list[bytes]:
    size = records.dtype.itemsize
    data = records.tobytes()
    return [data[start : start + size] for start in range(0, len(data), size)]


WRITERS: dict[str, Callable[..., None]] = {"cdr": write_cdr, "protobuf": write_protobuf, "json": write_json}


def main() -> None:
    """Write the logs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=int, default=600)
    parser.add_argument("--images", action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(exist_ok=True)
    data = drive(options.seconds)
    for name, write in WRITERS.items():
        write(options.folder / f"{name}.mcap", data, images=options.images)


if __name__ == "__main__":
    main()
