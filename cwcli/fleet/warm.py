"""What every log needs, imported once before the workers are forked."""

from __future__ import annotations

import numpy
import pyarrow.parquet
import pyproj

import cwcli.fleet.worker
import cwcli.logs.annotate
import cwcli.stages.estimate
import cwcli.stages.predict
import cwcli.stages.warn

__all__ = ["cwcli", "numpy", "pyarrow", "pyproj"]
