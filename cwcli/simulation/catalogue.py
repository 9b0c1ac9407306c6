"""The scenario files that come with cwcli. It imports little, so that the command line can list them quickly."""

from __future__ import annotations

from importlib.resources import files

from cwcli.registry import bundled_file_stems

SCENARIO_FILE_SUFFIX = ".toml"
"""File name ending of scenario files."""


def scenario_names() -> tuple[str, ...]:
    """Names of the scenarios that come with cwcli."""
    return bundled_file_stems("cwcli.simulation", "scenarios", SCENARIO_FILE_SUFFIX)


def scenario_text(name: str) -> str:
    """The text of a scenario file that comes with cwcli."""
    return (files("cwcli.simulation") / "scenarios" / f"{name}{SCENARIO_FILE_SUFFIX}").read_text(encoding="utf-8")
