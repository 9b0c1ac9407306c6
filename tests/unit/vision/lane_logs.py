"""Small logs with camera frames, written by the official writer."""

from __future__ import annotations

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap_protobuf.writer import Writer

from tests.unit.vision.fake_frames import encoded
from tests.unit.vision.scenes import LEFT, RIGHT, road_image

START_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000


def frame(data, stamp_ns, image_format="jpeg"):
    message = CompressedImage(frame_id="camera", data=data, format=image_format)
    message.timestamp.FromNanoseconds(stamp_ns)
    return message


def road_frames(n, *, suffix=".jpg", first=0):
    """n frames of the same road, each with its own noise."""
    return [encoded(road_image(LEFT, RIGHT, seed=first + k), suffix) for k in range(n)]


def calibration(width=320, height=240):
    message = CameraCalibration(frame_id="camera", width=width, height=height)
    message.K.extend([300.0, 0, 160, 0, 300.0, 90, 0, 0, 1])
    message.P.extend([300.0, 0, 160, 0, 0, 300.0, 90, 0, 0, 0, 1, 0])
    return message


def write_log(path, frames, *, topic="/camera/image", calibrations=(), step_ns=STEP_NS):
    """Frames 0.1 s apart; the log time is 5 ms behind the stamp.

    Args:
        frames: Encoded images.
        calibrations: (topic, message).
    """
    with path.open("wb") as file, Writer(file) as writer:
        for name, message in calibrations:
            writer.write_message(name, message, START_NS, START_NS)
        for k, data in enumerate(frames):
            stamp_ns = START_NS + k * step_ns
            writer.write_message(topic, frame(data, stamp_ns), stamp_ns + 5_000_000, stamp_ns + 5_000_000)
    return path
