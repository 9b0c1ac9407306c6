"""Imports the modules that every log needs, once, before workers are forked."""

from __future__ import annotations

import numpy
import pyarrow.parquet
import zstandard

import cwcli.fleet.worker
import cwcli.logs.codecs.cdr
import cwcli.logs.codecs.json
import cwcli.logs.codecs.protobuf
import cwcli.logs.read.added_channels
import cwcli.logs.read.columns
import cwcli.logs.read.message_reader
import cwcli.logs.write.annotate
from cwcli.stages import DEFAULT_STAGES, STAGES

__all__ = ["cwcli", "numpy", "pyarrow", "zstandard"]

for name in DEFAULT_STAGES:
    STAGES[name].imported_module  # noqa: B018 - imports it
pyarrow.array(numpy.zeros(1))  # at its first array it looks for pandas
