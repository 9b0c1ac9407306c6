"""`cwcli compare --messages` on whole runs: it names the one change that was made, and the first channel that differs.

What differs is found a second time with the official MCAP reader, from the payloads.
"""

from __future__ import annotations

import io
import json
import struct
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.json_format import MessageToDict
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_DONE
from tests.cli.conftest import SAMPLES

SECONDS = 6.0
"""Length of the drive, s; its warning is raised at 4.7 s."""
OWN_TOPICS = (
    "/cwcli/ego/state", "/cwcli/remote/state", "/cwcli/ego/online", "/cwcli/remote/online", "/cwcli/ego/fix",
    "/cwcli/ego/pose", "/cwcli/tf", "/cwcli/rejected", "/cwcli/ego/path", "/cwcli/remote/path", "/cwcli/paths/scene",
    "/cwcli/warnings", "/cwcli/log",
)  # fmt: skip
"""The channels of estimate, predict and warn in the order of docs/channels.md, which is that of the stages."""
OPTIONS = (
    ("--estimate-gate", "0.99", "estimate", "estimator.gate_probability", "0.999", "0.99"),
    ("--estimate-rate", "10", "estimate", "rate_hz", "20.0", "10.0"),
    ("--estimate-causal", None, "estimate", "estimator.causal", "false", "true"),
    ("--estimate-latency", "none", "estimate", "estimator.latency", '"auto"', '"none"'),
    ("--estimate-latency", "/gps/fix=80", "estimate", "estimator.latency", '"auto"', '{"/gps/fix": 0.08}'),
    ("--estimate-sensor-model", "none", "estimate", "estimator.sensor_model", '"auto"', '"none"'),
    ("--estimate-lever-arm", "/gps/fix=1.5,0", "estimate", "estimator.lever_arms./gps/fix", "", "[1.5, 0.0]"),
    ("--estimate-sigma", "ego_speed=0.9", "estimate", "estimator.sigmas.ego_speed", "", "[0.9]"),
    ("--predict-horizon", "3", "predict", "horizon_s", "2.5", "3.0"),
    ("--predict-model", "ctrv", "predict", "model", '"auto"', '"ctrv"'),
    ("--predict-step", "0.1", "predict", "step_s", "0.05", "0.1"),
    ("--predict-path-rate", "2", "predict", "path_rate_hz", "5.0", "2.0"),
    ("--warn-horizon", "2", "warn", "rule.horizon_s", "2.5", "2.0"),
    ("--warn-probability", "0.9", "warn", "rule.probability", "0.65", "0.9"),
    ("--warn-rule", "ttc", "warn", "rule.rule", '"cwcli"', '"ttc"'),
    ("--warn-persistence", "1", "warn", "rule.persistence_s", "null", "1.0"),
    ("--warn-conflict", "distance", "warn", "rule.conflict", '"distance or gap or ttc"', '"distance"'),
)
"""Option and its value -> stage, name of the setting, and its JSON without and with the option."""

Payloads = dict[tuple[int, int], bytes]
Decode = Callable[[bytes], Any]
Alter = Callable[[str, int, bytes], bytes | None]


def write_altered(source: Path, target: Path, alter: Alter) -> Path:
    """Copy a log with the official library; `alter` gets topic, place in the topic and payload; None drops it."""
    with source.open("rb") as stream, target.open("wb") as out:
        writer = Writer(out)
        writer.start()
        channels: dict[int, int] = {}
        places: dict[str, int] = {}
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            if channel.id not in channels:
                own = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, own)
            place = places[channel.topic] = places.get(channel.topic, -1) + 1
            data = alter(channel.topic, place, message.data)
            if data is not None:
                writer.add_message(channels[channel.id], message.log_time, data, message.publish_time)
        writer.finish()
    return target


def read_payloads(path: Path) -> tuple[dict[str, Payloads], dict[str, Decode]]:
    """Topic -> (log time, place among the messages of that time) -> payload; and topic -> decoder of protobuf."""
    found: dict[str, Payloads] = {}
    decoders: dict[str, Decode] = {}
    for schema, channel, message in make_reader(io.BytesIO(path.read_bytes())).iter_messages():
        messages = found.setdefault(channel.topic, {})
        place = sum((message.log_time, k) in messages for k in range(8))
        messages[message.log_time, place] = message.data
        if channel.topic not in decoders:
            decoders[channel.topic] = DecoderFactory().decoder_for(channel.message_encoding, schema) or bytes
    return found, decoders


def are_equal(early: Any, late: Any) -> bool:
    """Whether two messages hold the same; -0 equals 0, which their payloads do not show."""
    if early is None or late is None or isinstance(early, bytes):
        return bool(early == late)
    values = [MessageToDict(each, always_print_fields_with_no_presence=True) for each in (early, late)]
    return bool(values[0] == values[1])


def differing_topics(before: Path, after: Path) -> list[tuple[str, int, int]]:
    """Topic, log time of the first message that differs, and number of those that do; recorded topics first."""
    (early, decoders), (late, other_decoders) = read_payloads(before), read_payloads(after)
    recorded = [topic for topic in early if topic not in OWN_TOPICS]
    assert {*early, *late} <= {*recorded, *OWN_TOPICS}
    found = []
    for topic in (*recorded, *OWN_TOPICS):
        one, other = early.get(topic, {}), late.get(topic, {})
        decode = (decoders | other_decoders).get(topic, bytes)
        times = [
            key[0]
            for key in {**one, **other}
            if one.get(key) != other.get(key)
            and not are_equal(*(decode(data) if data is not None else None for data in (one.get(key), other.get(key))))
        ]
        if times:
            found.append((topic, min(times), len(times)))
    return found


class Base:
    """The drive, the constants of its car, and the run that all others are compared with."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        cut = folder / "cut.mcap"
        names = (str(SAMPLES / "rear-end.mcap"), "--end", str(SECONDS), "-o", str(cut), "-q")
        assert run_command_line(["cut", *names]) == EXIT_DONE
        self.log = write_altered(cut, folder / "drive.mcap", lambda topic, place, data: data)
        self.calibration = folder / "car.toml"
        command = ["calibrate", str(SAMPLES / "rear-end.mcap"), "-o", str(self.calibration), "-q"]
        assert run_command_line(command) == EXIT_DONE
        self.annotated = self.run("base")

    def run(self, name: str, *options: str, log: Path | None = None, calibration: Path | None = None) -> Path:
        """Annotate the drive."""
        target = self.folder / f"{name}.mcap"
        command = ["run", str(log or self.log), "--stage", "estimate,predict,warn", "-o", str(target), "-f", "-q"]
        command += ["--calibration", str(calibration or self.calibration), *options]
        assert run_command_line(command) == EXIT_DONE
        return target


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Base:
    return Base(tmp_path_factory.mktemp("base"))


def compare(capsys: pytest.CaptureFixture[str], base: Base, after: Path) -> dict[str, Any]:
    """What is said of the log, and its channels checked against the payloads."""
    capsys.readouterr()
    assert run_command_line(["compare", str(base.annotated), str(after), "--messages", "--json"]) == EXIT_DONE
    (log,) = json.loads(capsys.readouterr().out)["messages"]["differing"]
    named = [(each["topic"], each["at_ns"], each["different"]) for each in log["channels"]]
    assert named == differing_topics(base.annotated, after)
    assert isinstance(log, dict)
    return log


def settings(log: dict[str, Any]) -> list[tuple[str, ...]]:
    return [(each["stage"], each["name"], each["before"], each["after"]) for each in log["settings"]]


def change_option(base: Base, capsys: pytest.CaptureFixture[str], seed: int) -> None:
    option, value, *expected = OPTIONS[seed % len(OPTIONS)]
    log = compare(capsys, base, base.run(f"option{seed}", str(option), *([str(value)] if value else [])))
    assert settings(log) == [tuple(expected)]


def change_constant(base: Base, capsys: pytest.CaptureFixture[str], seed: int) -> None:
    """One value of the car's calibration, a tenth of its sigma greater."""
    lines = base.calibration.read_text().splitlines()
    rows = [k for k, line in enumerate(lines) if "value = " in line and 'status = "reference"' not in line]
    row = int(np.random.default_rng(seed).choice(rows))
    table = next(line for line in reversed(lines[:row]) if line.startswith("[")).strip("[]").replace('"', "")
    constant = tomllib.loads(lines[row].replace("\n", ""))
    ((name, values),) = constant.items()
    new = values["value"] + 0.1 * values["sigma"]
    lines[row] = lines[row].replace(f"value = {values['value']}", f"value = {new:.6g}")
    changed = base.folder / f"car{seed}.toml"
    changed.write_text("\n".join(lines))
    log = compare(capsys, base, base.run(f"constant{seed}", calibration=changed))
    ((stage, its_name, was, now),) = settings(log)
    assert (stage, its_name) == ("estimate", f"calibration.{table}.{name}.value")
    assert float(was) == values["value"]
    assert float(now) == pytest.approx(new, rel=1e-5)


def change_message(base: Base, capsys: pytest.CaptureFixture[str], seed: int) -> None:
    """One message that is missing, holds what the one before it holds, or states another latitude."""
    rng = np.random.default_rng(seed)
    before, _ = read_payloads(base.log)
    kind = ("missing", "repeated", "edited")[seed % 3]
    topic = "/gps/fix" if kind == "edited" else str(rng.choice(sorted(before)))
    keys = sorted(before[topic])
    place = int(rng.integers(1, len(keys)))

    def alter(its_topic: str, its_place: int, data: bytes) -> bytes | None:
        if (its_topic, its_place) != (topic, place):
            return data
        if kind == "missing":
            return None
        if kind == "repeated":
            return before[topic][keys[place - 1]]
        at = 4 + 8 + 4 + struct.unpack_from("<I", data, 12)[0]  # encapsulation, stamp, length and text of the frame
        at = (at + 3) // 2 * 2 + 2  # status int8, service uint16
        at = 4 + (at - 4 + 7) // 8 * 8  # doubles are aligned from the end of the encapsulation
        (latitude_deg,) = struct.unpack_from("<d", data, at)
        assert 28.0 < latitude_deg < 29.0
        return data[:at] + struct.pack("<d", latitude_deg + 1e-5) + data[at + 8 :]

    log = compare(
        capsys,
        base,
        base.run(f"message{seed}", log=write_altered(base.log, base.folder / f"altered{seed}.mcap", alter)),
    )
    assert settings(log) == []
    first = log["channels"][0]
    assert (first["topic"], first["at_ns"], first["different"]) == (topic, keys[place][0], 1)
    if kind == "missing":
        assert (first["field"], first["before"], first["after"]) == ("", "a message", "")
    elif kind == "edited":
        assert first["field"] == "latitude"
        assert float(first["after"]) - float(first["before"]) == pytest.approx(1e-5, abs=1e-9)
    else:
        assert first["field"]
        assert first["before"] != first["after"]


KINDS: Sequence[Callable[[Base, pytest.CaptureFixture[str], int], None]] = (
    change_option,
    change_constant,
    change_message,
)


@pytest.mark.parametrize("seed", [pytest.param(k, marks=[pytest.mark.long] if k > 2 else []) for k in range(50)])
def test_seeded_change_and_its_first_channel_are_named_exactly(
    base: Base, capsys: pytest.CaptureFixture[str], seed: int
) -> None:
    """Option, calibration value and message in turn: 17, 17 and 16 of the 50."""
    KINDS[seed % 3](base, capsys, seed // 3)
