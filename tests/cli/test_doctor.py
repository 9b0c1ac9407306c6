"""`cwcli info` as the doctor: why a channel is not used, what to try, how it was recorded, and a recording contract."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as JsonWriter
from mcap_ros2.writer import Writer

from cwcli.channels.binding import bind_roles
from cwcli.channels.reasons import suggest_map_options, unbound_reasons_by_topic
from cwcli.errors import InputError
from cwcli.input import InputFile
from cwcli.logs.format.chunks import ChunkError, decompress_chunk
from cwcli.logs.format.records import ChunkIndex
from cwcli.logs.read import message_reader
from cwcli.logs.read.channels import ChannelInfo
from cwcli.logs.read.reader import Log
from cwcli.pipeline.health import clock_drift_ms_per_min, measure_topic_health
from tests.cli.conftest import Run
from tests.cli.test_map import FIX, FRAME
from tests.laws.receiver_messages import HEADER, LINE, TOP

STATUS = LINE.join(
    [TOP + "my_msgs/Wheels wheels\nfloat64 target_speed", "MSG: my_msgs/Wheels\nfloat64 speed_kmh", *HEADER]
)
IMU_LIKE = "float64 x"
T0_NS = 1_700_000_000_000_000_000


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Two receivers, the second with a gap and a clock that loses 1 ms a second; a status, CAN frames, a stranger."""
    path = tmp_path / "odd.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        fix = writer.register_msgdef("sensor_msgs/msg/NavSatFix", FIX)
        status = writer.register_msgdef("my_msgs/msg/Status", STATUS)
        frame = writer.register_msgdef("can_msgs/msg/Frame", FRAME)
        stranger = writer.register_msgdef("my_msgs/msg/Stranger", IMU_LIKE)
        for k in range(200):
            at_ns = T0_NS + 100_000_000 * k
            for topic, late_ns in (("/gps/a", 20_000_000), ("/gps/b", 20_000_000 + 100_000 * k)):
                if topic == "/gps/b" and 100 <= k < 130:
                    continue
                header = {"stamp": dict(zip(("sec", "nanosec"), divmod(at_ns, 10**9), strict=True)), "frame_id": ""}
                where = {"latitude": 50.0 + k / 111_229.0, "longitude": 8.0, "altitude": 0.0, "status": {"status": 0}}
                none = {"position_covariance": [0.0] * 9, "position_covariance_type": 0}
                message = {"header": header, **where, **none}
                writer.write_message(topic, fix, message, at_ns + late_ns, at_ns + late_ns)
            made = {"header": header, "wheels": {"speed_kmh": 36.0}, "target_speed": 1.0}
            writer.write_message("/status", status, made, at_ns, at_ns)
            writer.write_message("/can", frame, {"header": header, "id": 1, "data": [0] * 8}, at_ns, at_ns)
            writer.write_message("/stranger", stranger, {"x": 1.0}, at_ns, at_ns)
        writer.finish()
    return path


def channel(document: dict, topic: str) -> dict:
    return next(each for each in document["channels"] if each["topic"] == topic)


def test_info_says_why_a_channel_is_not_used_and_what_to_try(cwcli: Run, log: Path) -> None:
    document = json.loads(cwcli("info", log, "--json").stdout)
    assert channel(document, "/gps/a")["why_not"].startswith("one of several candidates for ego_position")
    assert channel(document, "/gps/a")["try"] == [
        "--topic ego_position=/gps/a",
        "--topic ego_position=/gps/a,/gps/b",
    ]
    assert channel(document, "/status")["try"] == ["--map 'ego_speed=/status:wheels.speed_kmh*kmh'"]
    assert channel(document, "/can")["try"] == ["--map ego_speed=/can:MESSAGE.SIGNAL --dbc FILE"]
    assert channel(document, "/stranger") | {"why_not": "no role takes this type", "try": []} == channel(
        document, "/stranger"
    )
    estimate = document["commands"]["estimate"]
    assert (estimate["ready"], estimate["missing"], estimate["choose"]) == (False, [], ["ego_position"])
    shown = cwcli("info", log).stdout.decode()
    assert "has several for ego_position" in shown
    assert "try: --map 'ego_speed=/status:wheels.speed_kmh*kmh'" in shown
    assert max(map(len, shown.splitlines()[1:])) <= 80  # the first is the log's name


def test_a_line_to_try_works(cwcli: Run, log: Path) -> None:
    document = json.loads(cwcli("info", log, "--json").stdout)
    line = shlex.split(channel(document, "/status")["try"][0])  # the shell takes * for a pattern
    done = cwcli("info", log, *line, "--topic", "ego_position=/gps/a", "--json")
    found = {each["role"]: each for each in json.loads(done.stdout)["inputs"]}
    assert (found["ego_speed"]["used"], found["ego_speed"]["topic"]) == (200, "/status")


def test_info_looks_into_the_first_messages_where_no_definition_lists_the_fields(cwcli: Run, tmp_path: Path) -> None:
    path = tmp_path / "json.mcap"
    with path.open("wb") as stream:
        writer = JsonWriter(stream)
        writer.start()
        channel_id = writer.register_channel("/car", "json", writer.register_schema("Car", "jsonschema", b"{}"))
        for k in range(3):
            data = json.dumps({"motion": {"speed_kmh": 36.0 + k}, "name": "x"}).encode()
            writer.add_message(channel_id, log_time=T0_NS + k, publish_time=T0_NS + k, data=data)
        writer.finish()
    document = json.loads(cwcli("info", path, "--json").stdout)
    assert channel(document, "/car")["try"] == ["--map 'ego_speed=/car:motion.speed_kmh*kmh'"]


def test_doctor_finds_rate_gap_and_drift(cwcli: Run, log: Path) -> None:
    document = json.loads(cwcli("info", log, "--doctor", "--json").stdout)
    health = {each["topic"]: each for each in document["health"]}
    assert health["/gps/a"] == pytest.approx(
        {
            "topic": "/gps/a",
            **{"messages": 200, "undecodable": 0, "stamped": 200, "rate_hz": 10.0, "gaps": 0, "longest_gap_s": 0.0},
            **{"out_of_order": 0, "delay_s": 0.02, "drift_ms_per_min": 0.0},
        }
    )
    assert (health["/gps/b"]["gaps"], health["/gps/b"]["stamped"]) == (1, 170)
    assert health["/gps/b"]["longest_gap_s"] == pytest.approx(3.1, abs=0.01)
    assert health["/gps/b"]["drift_ms_per_min"] == pytest.approx(60.0, rel=0.05)
    assert health["/stranger"]["delay_s"] is None
    shown = cwcli("info", log, "--doctor").stdout.decode()
    assert max(map(len, shown.splitlines()[1:])) <= 80  # the first is the log's name


CONTRACT = """
min_duration_s = 15
roles = ["camera"]
[topics."/gps/a"]
schema = "sensor_msgs/NavSatFix"
min_rate_hz = 9.5
max_gap_s = 1
[topics."/gps/b"]
max_gap_s = 1
max_drift_ms_per_min = 10
[topics."/none"]
"""


def test_contract_is_judged_condition_by_condition(cwcli: Run, log: Path, tmp_path: Path) -> None:
    contract = tmp_path / "contract.toml"
    contract.write_text(CONTRACT)
    done = cwcli("info", log, "--expect", contract, "--json")
    assert done.returncode == 1
    verdicts = {(each["about"], each["condition"]): each["holds"] for each in json.loads(done.stdout)["contract"]}
    assert verdicts == {
        ("log", "duration_s >= 15"): True,
        ("log", "role camera"): False,
        ("/gps/a", "schema sensor_msgs/NavSatFix"): True,
        ("/gps/a", "rate_hz >= 9.5"): True,
        ("/gps/a", "gap_s <= 1"): True,
        ("/gps/b", "gap_s <= 1"): False,
        ("/gps/b", "drift_ms_per_min <= 10"): False,
        ("/none", "is there"): False,
    }
    assert b"BROKEN" in cwcli("info", log, "--expect", contract).stdout
    contract.write_text('min_messages = 1\n[topics."/gps/a"]\nmin_messages = 200\n')
    assert cwcli("info", log, "--expect", contract).returncode == 0


def test_a_topic_that_cannot_be_read_keeps_no_condition_on_its_messages(cwcli: Run, tmp_path: Path) -> None:
    path, contract = tmp_path / "strange.mcap", tmp_path / "contract.toml"
    with path.open("wb") as stream:
        writer = JsonWriter(stream)
        writer.start()
        channel_id = writer.register_channel("/x", "flatbuffer", 0)
        for at_s in (0, 1, 101, 102):
            writer.add_message(channel_id, log_time=T0_NS + at_s * 10**9, publish_time=T0_NS, data=b"?")
        writer.finish()
    contract.write_text('[topics."/x"]\nmax_undecodable = 0\nmax_gap_s = 1\nmax_out_of_order = 0\n')
    done = cwcli("info", path, "--expect", contract, "--json")
    document = json.loads(done.stdout)
    assert [(each["found"], each["holds"]) for each in document["contract"]] == [("not known", False)] * 3
    assert done.returncode == 1
    (health,) = document["health"]
    assert (health["messages"], health["undecodable"], health["gaps"], health["out_of_order"]) == (4, -1, None, None)
    assert b"flatbuffer" in cwcli("info", path, "--doctor").stdout


def test_damage_is_no_unknown_encoding(log: Path) -> None:
    data = bytearray(log.read_bytes())
    data[len(data) // 4] ^= 0xFF
    log.write_bytes(data)
    with Log.open(str(log)) as opened, pytest.raises(InputError, match="a chunk can't be decompressed"):
        measure_topic_health(opened, ["/gps/a"])
    with Log.open(str(log), recover=True) as opened:
        assert [each.topic for each in measure_topic_health(opened, ["/gps/a"])] == ["/gps/a"]


@pytest.mark.parametrize("is_damaged", [False, True])
def test_chunks_that_many_topics_share_are_unpacked_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_damaged: bool
) -> None:
    path = shared_log(tmp_path / "shared.mcap", n_topics=200)
    n_unpacked = count_unpacked_chunks(monkeypatch, is_damaged=is_damaged)
    with Log.open(str(path), recover=is_damaged) as log:
        found = measure_topic_health(log, [f"/{k}" for k in range(200)])
        n_chunks = log.n_chunks
    assert n_unpacked.total() == n_chunks > 1
    assert [each.topic for each in found] == [f"/{k}" for k in range(200)]
    assert {(each.messages, each.undecodable) for each in found} == {(10, -1 if is_damaged else 0)}


def test_chunks_beyond_the_bound_are_unpacked_for_each_topic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = shared_log(tmp_path / "shared.mcap", n_topics=200)
    with Log.open(str(path)) as log:
        sizes = [each.uncompressed_size for each in log.index.items_of_type(ChunkIndex)]
        monkeypatch.setattr(message_reader, "MAX_KEPT_CHUNK_BYTES", max(sizes) + sizes[0])  # one, and room for another
        n_unpacked = count_unpacked_chunks(monkeypatch, is_damaged=False)
        found = measure_topic_health(log, ["/0", "/1", "/2"])
        assert sorted(n_unpacked.values()) == [1, *[3] * (len(sizes) - 1)]
        log.columns("/3")
        assert min(n_unpacked.values()) == 2  # nothing is kept beyond the doctor
    assert {each.messages for each in found} == {10}


def shared_log(path: Path, n_topics: int) -> Path:
    """A log of several chunks, each with messages of all topics."""
    with path.open("wb") as stream:
        writer = JsonWriter(stream, chunk_size=100_000)
        writer.start()
        ids = [writer.register_channel(f"/{k}", "json", 0) for k in range(n_topics)]
        for second in range(10):
            for channel_id in ids:
                writer.add_message(channel_id, T0_NS + second * 10**9, b'{"a":"' + b"x" * 150 + b'"}', T0_NS)
        writer.finish()
    return path


def count_unpacked_chunks(monkeypatch: pytest.MonkeyPatch, *, is_damaged: bool) -> Counter[int]:
    """Place of a chunk -> how often it is unpacked from now on."""
    n_unpacked = Counter[int]()

    def unpack(file: InputFile, chunk: ChunkIndex, **options: Any) -> memoryview:
        n_unpacked[chunk.chunk_start] += 1
        if is_damaged:
            raise ChunkError("its CRC is wrong")
        return decompress_chunk(file, chunk, **options)

    monkeypatch.setattr(message_reader, "decompress_chunk", unpack)
    return n_unpacked


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "asks for nothing"),
        ("= 1", "not TOML"),
        ("min_rate = 1", "knows no min_rate"),
        ('[topics."/a"]\nmin_rate = 1', "knows no min_rate"),
        ('min_duration_s = "long"', "is not a number"),
        ("min_duration_s = -1", "is not a number"),
        ('roles = ["pilot"]', "list of roles"),
        ("topics = 3", "must be tables"),
        ('[topics."/gps/a"]\nschema = ["a", "b"]', "is not the name of a type"),
        (f"min_messages = 1{'0' * 400}", "is not a number"),
        (f'[topics."/gps/a"]\nmin_messages = 1{"0" * 400}', "is not a number"),
    ],
)
def test_contract_that_is_none_is_refused(cwcli: Run, log: Path, tmp_path: Path, text: str, words: str) -> None:
    contract = tmp_path / "contract.toml"
    contract.write_text(text)
    done = cwcli("info", log, "--expect", contract)
    assert (done.returncode, done.stdout) == (2, b"")
    assert words in done.stderr.decode()
    assert cwcli("info", log, "--expect", tmp_path / "nothing.toml").returncode == 2


@pytest.mark.parametrize(
    ("paths", "expected"),
    [
        (["speed"], ["--map ego_speed=/t:speed"]),
        (["kmh"], ["--map 'ego_speed=/t:kmh*kmh'"]),
        (["vehicleSpeedMph"], ["--map 'ego_speed=/t:vehicleSpeedMph*mph'"]),
        (["speed_limit", "target.speed", "engine_speed", "speed_accuracy"], []),
        (["fix.lat", "fix.lon", "fix.alt"], ["--map ego_position=/t:fix.lat,fix.lon"]),
        (["steering_angle_deg"], ["--map 'ego_steer=/t:steering_angle_deg*deg'"]),
        (["heading"], ["--map 'ego_heading=/t:-heading*deg+90deg'"]),
        (["x", "header.stamp.sec"], []),
    ],
)
def test_suggestions(paths: list[str], expected: list[str]) -> None:
    assert list(suggest_map_options("/t", paths)) == expected


@pytest.mark.parametrize(
    ("topic", "name", "tries"),
    [
        ("/vehicle/speed", "std_msgs/msg/Float32", ["--topic ego_speed=/vehicle/speed"]),
        ("/vehicle/speed_kmh", "std_msgs/msg/Float64", ["--map 'ego_speed=/vehicle/speed_kmh:data*kmh'"]),
        ("/cabin/temperature", "std_msgs/msg/Float32", []),
        ("/cmd_vel", "geometry_msgs/msg/Twist", []),
    ],
)
def test_a_type_that_says_nothing_is_told_by_its_topic(topic: str, name: str, tries: list[str]) -> None:
    info = ChannelInfo(1, topic, name, "ros2msg", "cdr", 5)
    assert list(unbound_reasons_by_topic([info], bind_roles([info], {}, required=()))[topic].tries) == tries


def test_a_station_that_may_be_the_ego_is_told(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    path = tmp_path / "radio.mcap"
    with intersection.open("rb") as source, path.open("wb") as target:
        reader, writer = make_reader(source), JsonWriter(target)
        writer.start()
        channel_id = writer.register_channel(
            "/v2x/bsm", "json", writer.register_schema("BasicSafetyMessage", "jsonschema", b"{}")
        )
        for _, _, message in reader.iter_messages(topics=["/v2x/bsm"]):
            writer.add_message(channel_id, message.log_time, message.data, message.publish_time)
        writer.finish()
    notes = json.loads(cwcli("info", path, "--json").stdout)["notes"]
    assert notes == ["a station of /v2x/bsm can be the ego: --ego-station d9583520"]


def test_drift_is_not_told_from_scatter() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        stamp_ns = T0_NS + np.arange(600) * 10**8
        late_ns = (2e7 + 5e6 * rng.exponential(size=600)).astype(np.int64)
        assert clock_drift_ms_per_min(stamp_ns, stamp_ns + late_ns) == 0.0
    drifting = (np.arange(600) * 2e4).astype(np.int64)  # 20 microseconds each 0.1 s: 12 ms a minute
    assert clock_drift_ms_per_min(stamp_ns, stamp_ns + late_ns + drifting) == pytest.approx(12.0, rel=0.1)


@pytest.mark.parametrize("last_ns", [2**63 - 1, 2**63, 2**64 - 1])
def test_log_times_of_all_64_bits_are_examined(tmp_path: Path, last_ns: int) -> None:
    """40 sound messages, and a last one whose log time is none: the gap before it is told, nothing else changes."""
    path = tmp_path / "late.mcap"
    with path.open("wb") as stream:
        writer = JsonWriter(stream)
        writer.start()
        channel_id = writer.register_channel("/a", "json", 0)
        for log_ns in (*(T0_NS + 100_000_000 * k for k in range(40)), last_ns):
            writer.add_message(channel_id, log_ns, b"{}", log_ns)
        writer.finish()
    with Log.open(path) as opened:
        (found,) = measure_topic_health(opened, ["/a"])
    assert (found.messages, found.gaps, found.undecodable) == (41, 1, 0)
    assert found.rate_hz == pytest.approx(10.0)
    assert found.longest_gap_s == pytest.approx((last_ns - T0_NS) / 1e9 - 3.9)


@pytest.mark.parametrize(
    ("role", "schema", "takes_many"), [("truth", "nav_msgs/msg/Odometry", False), ("imu", "sensor_msgs/msg/Imu", True)]
)
def test_several_topics_are_offered_only_where_a_role_takes_several(role: str, schema: str, takes_many: bool) -> None:
    topics = ("/truth/a", "/truth/b") if role == "truth" else ("/a", "/b")
    channels = [ChannelInfo(k, topic, schema, "ros2msg", "cdr", 5) for k, topic in enumerate(topics)]
    tries = unbound_reasons_by_topic(channels, bind_roles(channels, {}, required=(), optional=(role,)))[topics[0]].tries
    assert f"--topic {role}={topics[0]}" in tries
    assert (f"--topic {role}={','.join(topics)}" in tries) == takes_many
