"""Whether a change of the house left every output as it was: `python -m tests.studies.output_hashes --help`.

Runs each command on each log and keeps a SHA-256 of everything that came out: annotated logs, tables, exit codes.

    python -m tests.studies.output_hashes make before.json --cwcli OLD/bin/cwcli
    python -m tests.studies.output_hashes make after.json --cwcli NEW/bin/cwcli
    python -m tests.studies.output_hashes compare before.json after.json

The logs are those of `sample_logs/`, of scenarios that `cwcli simulate` makes meanwhile, and, where it is there, of the
folder `../shared/logs`. An annotated log has two hashes: of its bytes, and of its content with the records of the runs
(`cwcli.run.<stage>`: version, configuration, counts) left out. A name in a configuration may change; a message may not.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "logs"
RECORD = "cwcli.run."
SIMULATED = {
    "straight": ("simulate", "straight", "--seed", "3"),
    "road": ("simulate", "road", "--seed", "1", "--set", "duration_s=6"),
    "city": ("simulate", "city", "--seed", "3"),
}
"""Name -> the command that makes the log, for what the bundled logs do not hold."""


@dataclass(frozen=True)
class Step:
    """One command on the output of an earlier one.

    Attributes:
        name: Under which its output is kept; a later step may name it as its source.
        source: `log`, or the name of an earlier step.
        arguments: The command and its options, without input and output.
    """

    name: str
    source: str
    arguments: tuple[str, ...]


STEPS = (
    Step("estimate", "log", ("estimate",)),
    Step("causal", "log", ("estimate", "--causal")),
    Step("track", "estimate", ("track",)),
    Step("track-alone", "log", ("track",)),
    Step("lanes", "log", ("lanes",)),
    Step("lanes-zhang2011", "log", ("lanes", "--method", "zhang2011")),
    Step("observe", "lanes", ("observe",)),
    Step("predict", "estimate", ("predict",)),
    Step("predict-targets", "track", ("predict", "--model", "ctra")),
    Step("predict-observer", "observe", ("predict-lane",)),
    Step("warn", "predict", ("warn",)),
    Step("warn-ttc", "predict", ("warn", "--rule", "path-ttc")),
    Step("warn-targets", "predict-targets", ("warn-targets",)),
    Step("warn-lanes", "predict-observer", ("warn-lane",)),
    Step("control", "warn", ("control",)),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a list of hashes, or compare two; 1 if they differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    make = commands.add_parser("make", help="run everything and write the hashes")
    make.add_argument("target", type=Path)
    make.add_argument("--cwcli", default=str(Path(sys.executable).parent / "cwcli"), help="which cwcli")
    make.add_argument("--only", default="", help="only logs whose name holds one of these, with commas")
    compare = commands.add_parser("compare", help="compare two lists")
    compare.add_argument("before", type=Path)
    compare.add_argument("after", type=Path)
    options = parser.parse_args(arguments)
    if options.command == "make":
        with tempfile.TemporaryDirectory() as folder:
            hashes = everything(str(Path(options.cwcli).absolute()), Path(folder), options.only)
        options.target.write_text(json.dumps(hashes, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        print(f"{len(hashes)} outputs")
        return 0
    before, after = (json.loads(path.read_text(encoding="utf-8")) for path in (options.before, options.after))
    differences = list(differing(before, after))
    for line in differences:
        print(line)
    same = sum(before.get(key) == value for key, value in after.items())
    print(f"{same} outputs are the same bytes; {len(differences)} differ in more than the records of the runs")
    return 1 if differences else 0


def everything(cwcli: str, folder: Path, only: str) -> dict[str, dict[str, str]]:
    """Output -> its hashes, for every log."""
    simulated = folder / "simulated"
    simulated.mkdir()
    logs = sorted((ROOT / "sample_logs").glob("*.mcap"))
    for name, command in SIMULATED.items():
        path = simulated / f"simulated-{name}.mcap"
        subprocess.run([cwcli, *command, "-q", "-o", str(path)], check=True)
        logs.append(path)
    logs += sorted(SHARED.glob("*.mcap"))
    logs = [log for log in logs if any(part in log.name for part in only.split(","))]
    found: dict[str, dict[str, str]] = {}
    for log in logs:
        print(log.name, file=sys.stderr, flush=True)
        work = folder / log.stem
        work.mkdir()
        found |= {f"{log.stem}/{name}": value for name, value in one_log(cwcli, log, work)}
    fleet = folder / "fleet"
    run = subprocess.run(
        [cwcli, "run", *map(str, logs), "-q", "-d", str(fleet), "--tables", "--jobs", "2"],
        check=False,
        capture_output=True,
    )
    found["fleet/exit"] = {"content": str(run.returncode)}
    # The manifest and the metrics' document hold times and versions of the run.
    found |= {f"fleet/{name}": value for name, value in files(fleet) if not name.endswith(".json")}
    return found


def one_log(cwcli: str, log: Path, work: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The outputs of every command on one log."""
    outputs = {"log": log}
    for step in STEPS:
        source = outputs.get(step.source)
        if source is None:  # the step before it could not run, which its exit code tells
            continue
        target = work / f"{step.name}.mcap"
        tables = work / f"{step.name}.parquet"
        run = subprocess.run(
            [
                cwcli,
                step.arguments[0],
                str(source),
                *step.arguments[1:],
                "-q",
                "-o",
                str(target),
                "--metrics",
                str(tables),
            ],
            check=False,
            capture_output=True,
        )
        yield f"{step.name}/exit", {"content": str(run.returncode)}
        if run.returncode == 0:
            outputs[step.name] = target
    yield from whole_run(cwcli, log, work)
    yield from files(work)


def whole_run(cwcli: str, log: Path, work: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """`run` on one log, and the same stages in a pipe."""
    lane = ("--stage", "estimate,track,lanes,observe,predict-lane,warn-lane")
    control = ("--stage", "estimate", "--stage", "predict", "--stage", "warn", "--stage", "control")
    for name, more in (("run", ()), ("run-lane", lane), ("run-control", control)):
        run = subprocess.run(
            [cwcli, "run", str(log), *more, "-q", "-o", str(work / f"{name}.mcap"), "--metrics-dir", str(work / name)],
            check=False,
            capture_output=True,
        )
        yield f"{name}/exit", {"content": str(run.returncode)}
    quoted = (
        f"'{cwcli}' estimate '{log}' -q -o - | '{cwcli}' predict - -q -o - | '{cwcli}' warn - -q -o '{work}/piped.mcap'"
    )
    piped = subprocess.run(["bash", "-o", "pipefail", "-c", quoted], check=False, capture_output=True)
    yield "piped/exit", {"content": str(piped.returncode)}


def files(folder: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The hashes of every file below a folder."""
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            entry = {"bytes": hashlib.sha256(path.read_bytes()).hexdigest()}
            if path.suffix == ".mcap":
                entry["content"] = content_hash(path)
            else:
                entry["content"] = entry["bytes"]
            yield str(path.relative_to(folder)), entry


def content_hash(path: Path) -> str:
    """SHA-256 of what a log holds but the records of the runs: messages in their order, channels, schemas."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        digest.update(make_reader(file).get_header().profile.encode())
        file.seek(0)
        names: dict[int, str] = {}
        record: Any  # of a kind each, with other fields
        for record in StreamReader(file, record_size_limit=None).records:
            kind = type(record).__name__
            if kind == "Schema":
                names[record.id] = record.name
                digest.update(f"{kind} {record.name} {record.encoding}".encode() + record.data)
            elif kind == "Channel":
                digest.update(f"{kind} {record.id} {record.topic} {record.message_encoding} {record.metadata}".encode())
                digest.update(names.get(record.schema_id, "").encode())
            elif kind == "Message":
                digest.update(f"{record.channel_id} {record.sequence} {record.log_time} {record.publish_time}".encode())
                digest.update(record.data)
            elif kind == "Attachment":
                digest.update(f"{record.name} {record.log_time} {record.media_type}".encode() + record.data)
            elif kind == "Metadata" and not record.name.startswith(RECORD):
                digest.update(f"{record.name} {record.metadata}".encode())
    return digest.hexdigest()


def differing(before: dict[str, dict[str, str]], after: dict[str, dict[str, str]]) -> Iterator[str]:
    """A line for each output that is missing, new, or of another content."""
    for name in sorted(before.keys() | after.keys()):
        if name not in after:
            yield f"missing: {name}"
        elif name not in before:
            yield f"new: {name}"
        elif before[name]["content"] != after[name]["content"]:
            yield f"differs: {name}"


if __name__ == "__main__":
    sys.exit(main())
