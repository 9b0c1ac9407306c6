"""Whatever comes in: no crash, no NaN out, every detection accounted for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cwcli.tracking.config import IS_UNSCENTED_BY_FILTER, MOTION_MODELS, FilterConfig, TrackerConfig
from cwcli.tracking.detections import DetectionKind, Detections, EgoStates, SensorModel
from cwcli.tracking.tracker import track_many_targets, track_one_target

any_number = st.one_of(
    st.floats(-50.0, 50.0), st.floats(), st.sampled_from([0.0, -0.0, np.nan, np.inf, -np.inf, 1e300, -1.0, np.pi])
)
any_stamp = st.one_of(st.integers(0, 10**10), st.integers(-(2**63), 2**63 - 1))


@st.composite
def detections(draw):
    out = []
    for source, kind in (("lidar", DetectionKind.POSITION), ("radar", DetectionKind.RADAR)):
        n = draw(st.integers(0, 12))
        width = 2 if kind == DetectionKind.POSITION else 3
        covariance = draw(st.none() | hnp.arrays(np.float64, (n, width, width), elements=any_number))
        out.append(
            Detections(
                source,
                kind,
                draw(hnp.arrays(np.int64, n, elements=any_stamp)),
                draw(hnp.arrays(np.float64, (n, width), elements=any_number)),
                covariance=covariance,
            )
        )
    return out


@pytest.mark.filterwarnings("error::RuntimeWarning")
@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    data=detections(),
    name=st.sampled_from(list(IS_UNSCENTED_BY_FILTER)),
    model=st.sampled_from(list(MOTION_MODELS)),
    smooth=st.booleans(),
    cartesian=st.sampled_from([0.0, 0.3]),
    with_ego=st.booleans(),
)
def test_any_input_is_counted_and_gives_finite_states(data, name, model, smooth, cartesian, with_ego) -> None:
    single = FilterConfig(filter=name, model=model, smooth=smooth, cartesian_below=cartesian)
    stamp = np.arange(0, 10**10, 10**8)
    t: np.ndarray = stamp * 1e-9
    ego = EgoStates(stamp, 10.0 * t, 0.0 * t, 0.1 * t, np.full(len(t), 10.0), np.full(len(t), 0.1))
    sensors = {"radar": SensorModel(x_m=3.0, field_of_view_rad=2.0)}
    for run in (track_one_target, track_many_targets):
        result = run(data, sensors, TrackerConfig(single), ego if with_ego else None)
        for source in data:
            count = result.counts[source.source]
            assert count.read == len(source)
            assert count.used + sum(count.rejected.values()) == count.read
            assert count.used >= 0
        for track in result.tracks:
            assert np.isfinite(track.state).all()
            assert np.isfinite(track.covariance).all()
            assert (np.diff(track.stamp_ns.astype(float)) >= 0).all()
