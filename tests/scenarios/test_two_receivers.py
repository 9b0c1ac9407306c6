"""Two GNSS receivers and two IMUs on one car, each with its own place, delay, bias and noise, used together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.writer import Writer

from cwcli.errors import MissingSignalError, UsageError
from cwcli.estimation.config import EstimatorConfig
from cwcli.logs.read.reader import Log
from cwcli.pipeline.result import StageResult
from cwcli.signals.geodesy import LocalMap
from cwcli.stages.estimate import EstimateConfig, estimate
from cwcli.stages.inputs.sources import SourceConfig

T0_NS = 1_700_000_000_000_000_000
DURATION_S = 90.0
LINE = "=" * 80 + "\n"
STAMPED = LINE.join(
    [
        "",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
        "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
        "MSG: sensor_msgs/NavSatStatus\nint8 status\nuint16 service\n",
        "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
        "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    ]
)
FIX = (
    "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n"
    "float64[9] position_covariance\nuint8 position_covariance_type\n" + STAMPED
)
IMU = (
    "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n" + STAMPED
)
PLACES = {"/gps/a": (1.5, 0.3), "/gps/b": (-0.5, -0.4)}
DELAYS_S = {"/gps/a": 0.12, "/gps/b": 0.30}
SIGMAS_M = {"/gps/a": 0.3, "/gps/b": 0.8}
BIASES = {"/imu/a": (0.05, 0.01), "/imu/b": (-0.1, -0.02)}


def drive():
    time_s = np.arange(0.0, DURATION_S, 0.001)
    speed = np.interp(time_s, [0, 5, 20, 40, 60, 80, 90], [0, 5, 12, 6, 14, 3, 8])
    turn = 0.25 * np.sin(2 * np.pi * time_s / 17) * (speed > 1)
    yaw = 0.3 + 0.001 * np.cumsum(turn)
    x, y = (0.001 * np.cumsum(speed * along(yaw)) for along in (np.cos, np.sin))
    return time_s, x, y, yaw, speed, turn


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("two") / "two.mcap"
    time_s, x, y, yaw, speed, turn = drive()
    earth = LocalMap(50.0, 8.0, 100.0)
    rng = np.random.default_rng(3)
    messages: list[tuple[int, str, dict]] = []

    def add(topic: str, at_s: float, late_s: float, message: dict) -> None:
        stamp_ns = T0_NS + round((at_s + late_s) * 1e9)
        header = {"stamp": dict(zip(("sec", "nanosec"), divmod(stamp_ns, 10**9), strict=True)), "frame_id": ""}
        messages.append((stamp_ns, topic, {"header": header, **message}))

    for topic, rate_hz in (("/gps/a", 10), ("/gps/b", 5)):
        ahead_m, left_m = PLACES[topic]
        for at_s in np.arange(0.5, DURATION_S - 1, 1 / rate_hz):
            px, py, angle = (float(np.interp(at_s, time_s, values)) for values in (x, y, yaw))
            px += ahead_m * np.cos(angle) - left_m * np.sin(angle) + SIGMAS_M[topic] * rng.standard_normal()
            py += ahead_m * np.sin(angle) + left_m * np.cos(angle) + SIGMAS_M[topic] * rng.standard_normal()
            where = earth.wgs84_from_map(np.array([px]), np.array([py]), np.zeros(1))
            fix = dict(zip(("latitude", "longitude", "altitude"), (float(each[0]) for each in where), strict=True))
            covariance = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
            add(topic, at_s, DELAYS_S[topic], {"status": {"status": 0}, **fix, **covariance})
    accel = np.gradient(speed, 0.001)
    for topic, rate_hz in (("/imu/a", 50), ("/imu/b", 25)):
        for at_s in np.arange(0.0, DURATION_S - 1, 1 / rate_hz):
            forward, left, rate = (float(np.interp(at_s, time_s, each)) for each in (accel, speed * turn, turn))
            noise = np.array([0.05, 0.05, 0.05, 2e-3, 2e-3, 2e-3]) * rng.standard_normal(6)
            a = np.array([forward + BIASES[topic][0], left, 9.81]) + noise[:3]
            g = np.array([0.0, 0.0, rate + BIASES[topic][1]]) + noise[3:]
            message = {
                "linear_acceleration": dict(zip("xyz", a.tolist(), strict=True)),
                "angular_velocity": dict(zip("xyz", g.tolist(), strict=True)),
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                **{f"{name}_covariance": [0.0] * 9 for name in ("angular_velocity", "linear_acceleration")},
                "orientation_covariance": [-1.0] + [0.0] * 8,
            }
            add(topic, at_s, 0.0, message)
    with path.open("wb") as stream:
        writer = Writer(stream)
        fix_type, imu_type = (
            writer.register_msgdef(f"sensor_msgs/msg/{name}", text) for name, text in (("NavSatFix", FIX), ("Imu", IMU))
        )
        for stamp_ns, topic, message in sorted(messages, key=lambda each: each[0]):
            at_ns = stamp_ns + 10_000_000
            writer.write_message(topic, fix_type if topic in PLACES else imu_type, message, at_ns, at_ns)
        writer.finish()
    return path


def estimated(path: Path, **topics: str) -> StageResult:
    config = EstimateConfig(sources=SourceConfig(topics=topics), estimator=EstimatorConfig(lever_arms=PLACES))
    with Log.open(path) as log:
        return estimate(log, config)


def test_two_receivers_and_two_imus_have_their_own_delay_noise_and_bias(log: Path) -> None:
    result = estimated(log, ego_position="/gps/a,/gps/b", imu="/imu/a,/imu/b")
    sections = {section.key: section for section in result.summary.sections}
    rows = {(row[0], row[1]): row for row in sections["sources"].rows}
    assert {topic for topic, _ in rows} == {"/gps/a", "/gps/b", "/imu/a", "/imu/b"}
    latency = sections["sources"].columns.index("latency +- sigma [ms]")
    for topic, delay_s in DELAYS_S.items():
        assert float(str(rows[topic, "position"][latency]).split()[0]) == pytest.approx(1e3 * delay_s, abs=50.0)
    sigma_m = {row[0]: float(str(row[2]).split()[0]) for row in sections["noise"].rows if row[1] == "position"}
    assert sigma_m == {topic: pytest.approx(sigma, rel=0.15) for topic, sigma in SIGMAS_M.items()}
    state = next(channel.fields for channel in result.channels if channel.topic == "/cwcli/ego/state")
    time_s, x, y, *_ = drive()
    at_s = (np.asarray(state["stamp_ns"], np.int64) - T0_NS) * 1e-9
    # the map's origin is the first fix: a constant shift that the truth does not know
    off = np.stack([np.asarray(state["x_m"]) - np.interp(at_s, time_s, x), state["y_m"] - np.interp(at_s, time_s, y)])
    off = (off - np.median(off, axis=1, keepdims=True))[:, at_s > 5.0]
    assert np.hypot(*off).max() < 0.6


def test_two_receivers_are_named_with_the_option_for_both(log: Path) -> None:
    with pytest.raises(MissingSignalError, match="two channels hold the ego position") as raised:
        estimated(log)
    assert "--topic ego_position=/gps/a,/gps/b" in raised.value.hint


def test_topic_that_is_not_there_is_refused(log: Path) -> None:
    with pytest.raises(UsageError, match="/gps/c"):
        estimated(log, ego_position="/gps/a,/gps/c")
