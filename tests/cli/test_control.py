"""`cwcli control`: on a simulated log, after `estimate`, in a pipe, and where there is nothing to brake for."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from tests.cli.conftest import ROOT, SAMPLES, Run

PLATOON = ROOT.parent / "shared" / "logs" / "openacc-dynamic-part23.ros2.mcap"
POLICIES = ("no-action", "fuzzy", "driver")
OWN = {f"/cwcli/control/{policy}/{kind}" for policy in POLICIES for kind in ("state", "step", "pose")}


def topics(data: bytes) -> set[str]:
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    return {channel.topic for _, channel, _ in reader.iter_messages()}


@pytest.fixture(scope="module")
def braked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The issue's own command, on the bundled rear-end log."""
    folder = tmp_path_factory.mktemp("braked")
    arguments = ["control", str(SAMPLES / "rear-end.mcap"), "--predictor", "cj-cya", "-o", "braked.mcap"]
    subprocess.run(
        [sys.executable, "-m", "cwcli", *arguments, "--metrics", "control.parquet", "--quiet"],
        check=True,
        cwd=folder,
        env={"PYTHONPATH": str(ROOT)},
    )
    return folder


def test_simulated_log_is_estimated_and_braked(braked: Path) -> None:
    source = (SAMPLES / "rear-end.mcap").read_bytes()
    found = topics((braked / "braked.mcap").read_bytes())
    assert found >= topics(source) | OWN | {"/cwcli/ego/state", "/cwcli/remote/state"}
    rows = pq.read_table(braked / "control.parquet").to_pylist()
    assert {row["policy"]: row["collided"] for row in rows} == {"no-action": True, "fuzzy": False, "driver": True}


def test_steps_are_read_by_the_official_decoder(braked: Path) -> None:
    from mcap_protobuf.decoder import DecoderFactory

    with (braked / "braked.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        steps = [m for *_, m in reader.iter_decoded_messages(topics=["/cwcli/control/fuzzy/step"])]
    assert {step.policy for step in steps} == {"fuzzy"}
    assert {step.event_id for step in steps} == {1}
    assert all(step.throttle == 0.0 and step.brake_pressure_mpa == 0.0 for step in steps if step.since_warning_s < 0.0)
    assert max(step.brake_pressure_mpa for step in steps) > 3.0
    assert not steps[0].is_extrapolated
    assert steps[-1].is_extrapolated


def test_run_again_uses_the_states_that_are_there(cwcli: Run, braked: Path) -> None:
    done = cwcli("control", braked / "braked.mcap", "--predictor", "cv", "--json")
    assert done.returncode == 0, done.stderr.decode()
    told = json.loads(done.stdout)
    assert list(told["stages"]) == ["control"]
    refused = cwcli("control", braked / "braked.mcap", "-o", "again.mcap")
    assert refused.returncode != 0
    assert b"--replace" in refused.stderr
    assert cwcli("control", braked / "braked.mcap", "-o", "again.mcap", "--replace", "-q").returncode == 0


def test_earlier_warning_keeps_the_larger_distance(cwcli: Run, braked: Path) -> None:
    """Figure 12: constant speed warns last and collides, acceleration does not, jerk keeps the larger gap."""
    least = {}
    for predictor in ("cv", "ctra", "cj-cya"):
        done = cwcli("control", braked / "braked.mcap", "--predictor", predictor, "--json")
        rows = json.loads(done.stdout)["stages"]["control"]["sections"]["control"]
        (fuzzy,) = [row for row in rows if row["policy"] == "fuzzy"]
        least[predictor] = fuzzy["least_m"]
        assert fuzzy["hit"] == (predictor == "cv")
    assert least["cv"] < 2.5 < least["ctra"] < least["cj-cya"]


def test_in_a_pipe(braked: Path, tmp_path: Path) -> None:
    command = f"{sys.executable} -m cwcli"
    done = subprocess.run(
        [
            "bash",
            "-o",
            "pipefail",
            "-c",
            f"{command} estimate {SAMPLES}/rear-end.mcap -o - -q | "
            f"{command} control - --predictor cj-cya -o - -q --metrics {tmp_path}/c.csv > {tmp_path}/c.mcap",
        ],
        capture_output=True,
        check=False,
        cwd=ROOT,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr.decode()
    assert topics((tmp_path / "c.mcap").read_bytes()) >= OWN
    piped = list(csv.DictReader((tmp_path / "c.csv").open()))
    direct = pq.read_table(braked / "control.parquet").to_pylist()
    assert [float(row["min_distance_m"]) for row in piped] == [row["min_distance_m"] for row in direct]


def test_simulated_variant_is_braked(cwcli: Run) -> None:
    done = cwcli("simulate", "intersection", "--set", "host.speed_mps=12", "--seed", "7", "-o", "crossing.mcap")
    assert done.returncode == 0, done.stderr.decode()
    done = cwcli("control", "crossing.mcap", "--json")
    assert done.returncode == 0, done.stderr.decode()


def test_no_warning_is_no_error(cwcli: Run, tmp_path: Path) -> None:
    if not PLATOON.exists():
        pytest.skip("the development logs in ../shared/logs are not here")
    done = cwcli("control", PLATOON, "-o", "out.mcap", "--metrics", "control.csv")
    assert done.returncode == 0, done.stderr.decode()
    assert "no warning arises" in " ".join(done.stderr.decode().split())
    assert not topics((tmp_path / "out.mcap").read_bytes()) & OWN
    assert len((tmp_path / "control.csv").read_text().splitlines()) == 1  # the heading


def test_log_without_other_vehicles(cwcli: Run) -> None:
    done = cwcli("control", SAMPLES / "straight.mcap")
    assert done.returncode == 4
    assert b"remote vehicles" in done.stderr


def test_states_of_the_ego_alone_name_the_command_to_run(cwcli: Run) -> None:
    assert cwcli("estimate", SAMPLES / "straight.mcap", "--causal", "-o", "e.mcap", "-q").returncode == 0
    done = cwcli("control", "e.mcap")
    assert done.returncode == 4
    assert b"cwcli estimate" in done.stderr


@pytest.mark.parametrize(
    "options", [("--predictor", "unknown"), ("--rule", "unknown"), ("--duration", "0"), ("--after", "-1")]
)
def test_wrong_options(cwcli: Run, options: tuple[str, ...]) -> None:
    assert cwcli("control", SAMPLES / "rear-end.mcap", *options).returncode == 2
