"""What the gate rejects is named, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from cwcli.estimation.config import EstimatorConfig
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.track import estimate_track

START_NS = 1_700_000_000_123_456_789


def test_outliers_are_named_with_their_stamps_and_the_bound() -> None:
    rng = np.random.default_rng(3)
    stamp_ns = START_NS + np.arange(300) * 100_000_000
    time_s = (stamp_ns - START_NS) / 1e9
    xy = np.column_stack([10.0 * time_s, np.zeros(300)]) + rng.normal(0.0, 0.3, (300, 2))
    wrong = [120, 200]
    xy[wrong] += 50.0
    noise = np.full((300, 2), 0.09)
    fixes = Measurements("/gps/fix", Kind.POSITION, stamp_ns, xy, noise)
    track = estimate_track([fixes], EstimatorConfig(latency="none"), stamp_ns[::2])
    found = track.gated
    named = found.stamp_ns.tolist()
    assert set(stamp_ns[wrong].tolist()) <= set(named)
    assert len(named) == track.sources[0].n_gated
    assert (found.nis > found.bound).all()
    assert found.bound[0] == pytest.approx(stats.chi2.ppf(0.999, 2), rel=1e-6)
    assert {found.topic.values[code] for code in found.topic.codes} == {"/gps/fix"}
    assert {found.quantity.values[code] for code in found.quantity.codes} == {"position"}
