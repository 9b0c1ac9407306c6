"""The readers for the conformance suite's runner: all 416 files, against what the suite expects of them."""

from __future__ import annotations

import json
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from cwcli.input import InputFile
from tests.conformance_runner import READERS, Document, supports, written
from tests.unit.logs_read.conformance import CONTENTS, every_file

FILES = {name: data for name, _, data in every_file()}
ROOT = Path(__file__).parents[3]

SHA256 = {
    "NoData": "ddd9eefeb5aa8cb3590b285db8a42a390cd3964ac76973ac517b5dbdd274dfa0",
    "OneAttachment": "3c900de032a40fcc852c90dfbfa9f1fff1a740e14d9ce9e3b3ab9b6438d5d82a",
    "OneMetadata": "144d3c01af37b57907c2762fa16fb16c5e17c37395fb22c56b5eb52397a9f49b",
    "OneSchemalessMessage": "a593808b6709ba02e343e240c61824b736fecf8588bec36291a6681b8db6cd77",
    "OneMessage": "bc971f80d4786216661a58e50ce338780246aeaf3827f821469b67e110b93f64",
    "TenMessages": "f56acb521547fa81d5f6d3e8068796357bb77b0855c1b2c9934022362238676f",
}
"""Of the lines `NAME SHA256` of a content's published expectations, by name; each as JSON with sorted keys."""


def digest(documents: dict[str, Document]) -> str:
    lines = (
        f"{name} {sha256(json.dumps(each, sort_keys=True).encode()).hexdigest()}\n" for name, each in documents.items()
    )
    return sha256("".join(lines).encode()).hexdigest()


def expected_of_indexed(records: list[Document]) -> Document:
    """What the suite makes of a file's records for readers that go by an index."""

    def fields(record: Document) -> Document:
        return dict(record["fields"])

    def defined(kind: str) -> list[Document]:
        found: dict[int, Document] = {}
        for each in records:
            if each["type"] == kind:
                found.setdefault(int(fields(each)["id"]), each)
        return [found[key] for key in sorted(found)]

    messages = [each for each in records if each["type"] == "Message"]
    return {
        "schemas": defined("Schema"),
        "channels": defined("Channel"),
        "messages": sorted(messages, key=lambda each: int(fields(each)["log_time"])),
        "statistics": [each for each in records if each["type"] == "Statistics"],
    }


@pytest.mark.parametrize("content", CONTENTS)
def test_every_file_is_read_as_the_suite_expects(tmp_path: Path, content: str) -> None:
    path = tmp_path / "in.mcap"
    streamed: dict[str, Document] = {}
    for name, data in sorted(FILES.items()):
        if name.split("-")[0] == content:
            path.write_bytes(data)
            with InputFile.open(path) as file:
                streamed[name] = READERS["streamed"](file)
                indexed = READERS["indexed"](file)
            assert indexed == expected_of_indexed(streamed[name]["records"]), name
    assert digest(streamed) == SHA256[content]


def wanted(name: str, path: Path) -> Document:
    """What the suite gives a writer: the records of the file and its features."""
    path.write_bytes(FILES[name])
    with InputFile.open(path) as file:
        return {**READERS["streamed"](file), "meta": {"variant": {"features": name.split("-")[1:]}}}


def test_every_file_without_padding_is_written_byte_for_byte(tmp_path: Path) -> None:
    supported = [name for name in FILES if supports(name.split("-")[1:])]
    differing = [name for name in supported if written(wanted(name, tmp_path / "in.mcap")) != FILES[name]]
    assert (len(FILES), len(supported), differing) == (416, 208, [])


def test_the_command_writes_or_says_that_it_does_not(tmp_path: Path) -> None:
    for name, code in (("OneMessage-ch-mx", 0), ("OneMessage-ch-pad", 2)):
        (tmp_path / "in.json").write_text(json.dumps(wanted(name, tmp_path / "in.mcap")))
        command = [sys.executable, "-m", "tests.conformance_runner", "write", str(tmp_path / "in.json")]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, check=False)
        assert (done.returncode, done.stdout) == (code, b"" if code else FILES[name])


def test_the_command_prints_json(tmp_path: Path) -> None:
    (tmp_path / "in.mcap").write_bytes(FILES["OneMessage"])
    command = [sys.executable, "-m", "tests.conformance_runner", "streamed", str(tmp_path / "in.mcap")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    kinds = [each["type"] for each in json.loads(done.stdout)["records"]]
    assert kinds == ["Header", "Schema", "Channel", "Message", "DataEnd", "Footer"]
