"""States read back from channels of older versions."""

from __future__ import annotations

from typing import Any

import numpy as np

from cwcli.channels.vehicle_state import FLAG_BY_FIELD, read_vehicle_states
from cwcli.signals.columns import Columns
from tests.laws.channel_cases import of_states


def test_states_of_an_older_version_have_no_flags() -> None:
    """The fields starting, after_reset, bridged and rejecting came later: a log without them is read as before."""
    written = of_states(np.random.default_rng(0), 5).channels[0]
    assert set(FLAG_BY_FIELD) == {"starting", "after_reset", "bridged", "rejecting"}
    fields: dict[str, Any] = {name: field for name, field in written.fields.items() if name not in FLAG_BY_FIELD}
    n = np.arange(5, dtype=np.uint32)
    log_time_ns = written.log_time_ns
    columns = Columns(written.topic, written.schema_name, "protobuf", log_time_ns, log_time_ns, n, fields)
    assert read_vehicle_states(columns).flags.tolist() == [0] * 5


def test_covariances_of_an_older_version_are_read_as_they_are() -> None:
    """They were 64 doubles in one field; the fields sigma and correlation came later."""
    written = of_states(np.random.default_rng(0), 5).channels[0]
    given = np.eye(8) + 0.1 * np.random.default_rng(1).uniform(size=(5, 1, 1))
    fields: dict[str, Any] = {
        name: field for name, field in written.fields.items() if name not in ("sigma", "correlation")
    }
    fields["covariance"] = given.reshape(5, 64)
    log_time_ns, n = written.log_time_ns, np.arange(5, dtype=np.uint32)
    columns = Columns(written.topic, written.schema_name, "protobuf", log_time_ns, log_time_ns, n, fields)
    assert np.array_equal(read_vehicle_states(columns).covariance, given)
