"""The fixtures of the command line's tests serve the peers' too."""

from __future__ import annotations

from tests.cli.conftest import cwcli, intersection, predicted

__all__ = ["cwcli", "intersection", "predicted"]
