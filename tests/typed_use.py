"""How a typed program uses cwcli: `mypy --strict` checks it (pyproject.toml), nothing runs it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, assert_type

import cwcli

if TYPE_CHECKING:
    from mcap.decoder import DecoderFactory


def use_every_public_name(steps: list[str]) -> None:
    """Name the type that each public name has for a program."""
    try:
        log = cwcli.open("drive.mcap", topics={"ego_position": "/gps/fix"}, start=1.5, limits=cwcli.Limits())
        assert_type(log, cwcli.Log)
        assert_type(log.topics, tuple[str, ...])
        result = log.run("estimate", "warn", options={"estimate": {"rate": 10, "latency": ["/gps/fix=0.1"]}})
        assert_type(result, cwcli.Result)
        assert_type(log.run(progress=steps.append).left_out, dict[str, str])
        assert_type(result.save(Path("annotated.mcap"), tables="tables"), list[Path])
        assert_type(cwcli.report(result, "report.html"), Path)
        assert_type(cwcli.simulate("road", "road.mcap", values={"duration_s": 1}), Path)
        assert_type(cwcli.decoder_factory(), DecoderFactory)
        assert_type(cwcli.__version__, str)
        log.run(clock="logg")  # type: ignore[arg-type]
        cwcli.opne("drive.mcap")  # type: ignore[attr-defined]
    except (cwcli.UsageError, cwcli.InputError, cwcli.MissingSignalError, cwcli.DataError) as error:
        assert_type(error.hint, str)
    except (cwcli.OutputError, cwcli.CwcliError) as error:
        assert_type(error.exit_code, int)
