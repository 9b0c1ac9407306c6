"""A log of radio stations, one of them the ego's: whose messages are whose, what is no fault, and what then works."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from mcap.writer import Writer
from mcap_ros2.writer import Writer as Ros2Writer

from tests.cli.conftest import Run
from tests.unit.signals.radio import packing

OWN_STATION = "00000001"


def ego_and_other(path: Path, *, bad_fix: int | None = None, with_fixes: bool = True) -> Path:
    """A drive of 10 s with GNSS and messages of two stations, one of which is the ego's."""
    with Path(path).open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foxglove.LocationFix", "jsonschema", b"{}")
        fixes = writer.register_channel("/gps/fix", "json", schema) if with_fixes else None
        heard = writer.register_channel(
            "/v2x/bsm", "json", writer.register_schema("BasicSafetyMessage", "jsonschema", b"{}")
        )
        for k in range(100):
            time_ns = 1_700_000_000_000_000_000 + k * 100_000_000
            latitude_deg = 91.0 if k == bad_fix else 51.0 + 1e-5 * k
            stamp = {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}
            fix = {"timestamp": stamp, "latitude": latitude_deg, "longitude": 13.7, "altitude": 100.0}
            if fixes is not None:
                writer.add_message(fixes, time_ns, json.dumps(fix).encode(), time_ns)
            for station, lane_deg in ((OWN_STATION, 0.0), ("000000A7", 1e-4)):
                core = {
                    "msgCnt": k, "id": station, "secMark": (time_ns // 10**6) % 60_000,
                    "lat": round((51.0 + 1e-5 * k) * 1e7), "long": round((13.7 + lane_deg) * 1e7), "elev": 1000,
                    "speed": 556, "heading": 0,
                }  # fmt: skip
                writer.add_message(heard, time_ns, json.dumps({"coreData": core}).encode(), time_ns)
        writer.finish()
    return path


def test_strict_takes_what_is_only_set_aside(cwcli: Run, tmp_path: Path) -> None:
    """The ego's own messages are none of the others', and the other way round: no fault."""
    ego_and_other(tmp_path / "d.mcap")
    done = cwcli("estimate", "d.mcap", "--ego-station", OWN_STATION, "--strict", "--json")
    assert done.returncode == 0, done.stderr.decode()
    (remote,) = (
        entry for entry in json.loads(done.stdout)["stages"]["estimate"]["inputs"] if entry["role"] == "remote"
    )
    assert sum(remote["set_aside"].values()) == 100
    assert (remote["used"], remote["rejected"], remote["repaired"]) == (100, {}, {})


def test_digest_says_which_station_is_the_car(cwcli: Run, tmp_path: Path) -> None:
    ego_and_other(tmp_path / "d.mcap", with_fixes=False)
    done = cwcli("estimate", "d.mcap", "--ego-station", OWN_STATION, details=False)
    said = f"/v2x/bsm: the car is V2X station {OWN_STATION}, named by --ego-station."
    assert said in " ".join(done.stdout.decode().split())


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "--topic", "remote=/v2x/bsm", "-o", "o.mcap"),
        ("estimate", "-o", "o.mcap"),
        ("estimate", "--ego-station", "000000FF", "-o", "o.mcap"),
    ],
)
def test_a_log_of_stations_alone_lists_them_and_the_option_that_works(
    cwcli: Run, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    ego_and_other(tmp_path / "d.mcap", with_fixes=False)
    done = cwcli(arguments[0], "d.mcap", *arguments[1:])
    assert done.returncode == 4
    said = " ".join(done.stderr.decode().split())
    assert f"V2X stations {OWN_STATION} (100 messages), 000000A7 (100 messages)" in said
    assert f"name it: --ego-station {OWN_STATION}" in said
    assert cwcli("estimate", "d.mcap", "--ego-station", OWN_STATION, "-o", "o.mcap").returncode == 0


def test_strict_names_topic_time_and_count_of_a_fault(cwcli: Run, tmp_path: Path) -> None:
    ego_and_other(tmp_path / "d.mcap", bad_fix=42)
    done = cwcli("estimate", "d.mcap", "-o", "e.mcap", "--strict")
    assert done.returncode == 5
    assert re.search(r"/gps/fix rejected: 1 .*, the first at 4\.200 s", done.stderr.decode())
    assert not (tmp_path / "e.mcap").exists()


def octets_of_the_ego(path: Path) -> Path:
    """What the ego's radio sent and received, as octets in a message of its maker: BSMs of both stations."""
    zero = dict.fromkeys(packing.CORE, 0)
    with path.open("wb") as stream:
        writer = Ros2Writer(stream)
        raw = writer.register_msgdef("maker_msgs/msg/Raw", "uint8[] payload")
        for k in range(100):
            time_ns = 1_700_000_000_000_000_000 + k * 100_000_000
            for station, lane_deg in ((1, 0.0), (0xA7, 1e-4)):
                core = {
                    **{"coreData.msgCnt": k, "coreData.id": station, "coreData.transmission": 2},
                    **{"coreData.secMark": (time_ns // 10**6) % 60_000, "coreData.speed": 556, "coreData.heading": 0},
                    **{"coreData.lat": round((51.0 + 1e-4 * k / 2) * 1e7), "coreData.elev": 1000},
                    "coreData.long": round((13.7 + lane_deg) * 1e7),
                }
                octets = packing.framed(packing.bsm(zero | core))
                writer.write_message("/radio/raw", raw, {"payload": list(octets)}, time_ns, time_ns)
        writer.finish()
    return path


def test_the_egos_own_octets_are_its_position_and_its_speed(cwcli: Run, tmp_path: Path) -> None:
    """The format behind the topic says what octets are, for the ego's roles as for the others'."""
    log = octets_of_the_ego(tmp_path / "raw.mcap")
    roles = [
        word for role in ("ego_position", "ego_speed", "remote") for word in ("--topic", f"{role}=/radio/raw:j2735")
    ]
    done = cwcli("estimate", log, *roles, "--ego-station", OWN_STATION, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["stages"]["estimate"]["inputs"]
    used = {each["role"]: each["used"] for each in found}
    assert used == {"ego_position": 100, "ego_speed": 100, "remote": 100}
    wrong = cwcli("estimate", log, "--topic", "ego_position=/radio/nothing:btp", "--ego-station", OWN_STATION)
    assert wrong.returncode == 2
    assert "the log has no topic /radio/nothing" in wrong.stderr.decode()
    nobody = cwcli("estimate", log, *roles)
    assert nobody.returncode == 4
    assert "--ego-station" in nobody.stderr.decode()


SECOND_STATION = "00 '0A7"
"""An ID that a shell takes apart unless it is quoted."""


def two_receivers(path: Path) -> Path:
    """A log without fixes whose two V2X topics hold a station each."""
    with Path(path).open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("BasicSafetyMessage", "jsonschema", b"{}")
        channels = [writer.register_channel(topic, "json", schema) for topic in ("/a/bsm", "/b/bsm")]
        for k in range(100):
            time_ns = 1_700_000_000_000_000_000 + k * 100_000_000
            for channel, station, lane_deg in zip(channels, (OWN_STATION, SECOND_STATION), (0.0, 1e-4), strict=True):
                core = {
                    "msgCnt": k, "id": station, "secMark": (time_ns // 10**6) % 60_000,
                    "lat": round((51.0 + 1e-5 * k) * 1e7), "long": round((13.7 + lane_deg) * 1e7), "elev": 1000,
                    "speed": 556, "heading": 0,
                }  # fmt: skip
                writer.add_message(channel, time_ns, json.dumps({"coreData": core}).encode(), time_ns)
        writer.finish()
    return path


def ego_options(words: list[str]) -> list[str]:
    """`words` with each role of the ego taken from the second topic."""
    roles = [f"ego_{quantity}=/b/bsm" for quantity in ("position", "speed", "heading")]
    return [*words, "--topic", "remote=/a/bsm", *(word for role in roles for word in ("--topic", role))]


def test_info_names_a_station_of_the_topic_and_the_line_works_when_pasted(cwcli: Run, tmp_path: Path) -> None:
    two_receivers(tmp_path / "d.mcap")
    shown = cwcli("info", "d.mcap", "--topic", "remote=/a/bsm")
    (tried,) = re.findall(r"^try: (--ego-station .*)$", shown.stdout.decode(), re.MULTILINE)
    assert shlex.split(tried) == ["--ego-station", SECOND_STATION]
    noted = " ".join(shown.stderr.decode().split())
    assert f"can be the ego: --ego-station {OWN_STATION} or {shlex.quote(SECOND_STATION)}" in noted
    done = cwcli("estimate", "d.mcap", *ego_options(shlex.split(tried)), "-o", "o.mcap")
    assert done.returncode == 0, done.stderr.decode()


def test_an_error_names_a_station_of_the_topic_that_was_chosen(cwcli: Run, tmp_path: Path) -> None:
    two_receivers(tmp_path / "d.mcap")
    done = cwcli("estimate", "d.mcap", *ego_options([]), "-o", "o.mcap")
    assert done.returncode == 4
    said = " ".join(done.stderr.decode().split())
    assert f"V2X stations {SECOND_STATION} (100 messages) hint:" in said
    (tried,) = re.findall(r"name it: (--ego-station .*)$", said)
    assert shlex.split(tried) == ["--ego-station", SECOND_STATION]


def test_an_error_does_not_offer_the_station_that_was_given(cwcli: Run, tmp_path: Path) -> None:
    """Two topics could be the ego's position: another station is no way out, a choice of the topic is."""
    two_receivers(tmp_path / "d.mcap")
    done = cwcli("estimate", "d.mcap", "--ego-station", OWN_STATION, "-o", "o.mcap")
    assert done.returncode == 4
    said = done.stderr.decode()
    assert "name it: --ego-station" not in said
    assert "--topic ego_position=/a/bsm" in said
