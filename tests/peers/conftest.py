"""The fixtures of the command line's tests serve the peers' too."""

from __future__ import annotations

from tests.cli.conftest import cwcli, intersection, predicted, warm_process

__all__ = ["cwcli", "intersection", "predicted", "warm_process"]
