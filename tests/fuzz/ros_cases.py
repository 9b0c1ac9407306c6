"""Cases of the level `ros`: a mutated log through `cwcli export --format ros2`, read by the official decoder.

Each message of the log that is written can be decoded, holds what cwcli reads in it, and recorded messages of ROS are
in it byte for byte.
"""

from __future__ import annotations

import io
import tempfile
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path

from mcap.reader import NonSeekingReader

from cwcli.cli.main import run_command_line
from cwcli.errors import EXIT_BUG, EXIT_CODES, EXIT_NOT_WRITTEN, CwcliError
from cwcli.export.ros.convert import ROS_TOPIC_PREFIX
from cwcli.logs.read.reader import Log
from tests.fuzz.file_cases import annotated_drive, fast_folder
from tests.fuzz.logs import mutated_log
from tests.fuzz.mutate import Rng
from tests.unit.logs_read.official import assert_same, read_officially

N_INPUTS = 2
Recorded = Counter[tuple[str, int, bytes]]


def check_case(rng: Rng) -> dict[str, int]:
    """Mutate an annotated log and export it; counts of inputs and of exit codes."""
    counts: Counter[str] = Counter()
    for _ in range(N_INPUTS):
        check_export(mutated_log(rng, annotated_drive()), counts)
    return dict(counts)


def check_export(data: bytes, counts: Counter[str]) -> None:
    """Export a log.

    Raises:
        AssertionError: The exit code is not documented, or a message is not what it was.
    """
    counts["inputs"] += 1
    with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
        path, out = Path(folder) / "in.mcap", Path(folder) / "out.mcap"
        path.write_bytes(data)
        shown = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
        with redirect_stdout(shown), redirect_stderr(shown):
            code = run_command_line(["export", str(path), "--format", "ros2", "-o", str(out)])
        counts[f"exit {code}"] += 1
        shown.flush()
        assert code in EXIT_CODES and code not in {EXIT_BUG, EXIT_NOT_WRITTEN}, shown.buffer.getvalue().decode()
        assert out.exists() == (code == 0)
        if code:
            return
        counts["accepted"] += 1
        try:
            read_officially(data)
        except Exception:  # it raises what it comes upon, as where the summary lacks a channel
            counts["refused by the official reader"] += 1
            return
        written = out.read_bytes()
        official = read_officially(written)
        with Log.open(out) as log:
            for topic in official:
                assert not (topic.startswith(ROS_TOPIC_PREFIX) and official[topic].n_undecodable), topic
                with suppress(CwcliError):
                    columns = log.columns(topic)
                    # the official decoder takes recorded messages of XCDR2 for XCDR1
                    if columns.n_undecodable == official[topic].n_undecodable or topic.startswith(ROS_TOPIC_PREFIX):
                        assert_same(columns, official[topic], expect_paths=False)
        before = recorded_messages(data)
        if before is not None:
            counts["compared"] += 1
            after = recorded_messages(written)
            assert after is not None
            assert not after - before, list((after - before).items())[:1]


def recorded_messages(data: bytes) -> Recorded | None:
    """The messages that were not converted, by the official reader; None if it refuses the log."""
    found: Recorded = Counter()
    try:
        for _, channel, message in NonSeekingReader(io.BytesIO(data)).iter_messages():
            if not channel.topic.startswith(ROS_TOPIC_PREFIX):
                found[channel.topic, message.log_time, message.data] += 1
    except Exception:  # it raises what it comes upon
        return None
    return found
