"""Whose clock the latencies count from: where the sources agree, and no measurement is early."""

from __future__ import annotations

import pytest

from cwcli.estimation import Kind, Latency, LatencyStatus
from cwcli.estimation.latency_clock import SourceLatency, shift_latencies_to_agreed_clock_and_note

KINDS = {"imu": Kind.ACCEL, "gnss": Kind.POSITION, "wheel": Kind.SPEED, "compass": Kind.HEADING}


def said(**ms: tuple[float, float]) -> dict[str, Latency]:
    """Each source's latency against the IMU and its sigma, milliseconds; applied beyond three sigma."""
    return {
        name: Latency(
            LatencyStatus.APPLIED if abs(value) > 3.0 * sigma else LatencyStatus.NOT_SIGNIFICANT,
            1e-3 * value,
            1e-3 * sigma,
            1e-3,
        )
        for name, (value, sigma) in ms.items()
    }


def agreed(latencies: dict[str, Latency]) -> tuple[dict[str, Latency], list[str]]:
    """On the agreed clock, by source; the IMU is what the search compared with."""
    all_of = {"imu": Latency(LatencyStatus.REFERENCE), **latencies}
    told = [SourceLatency(name, KINDS[name], name == "imu", latency) for name, latency in all_of.items()]
    moved, notes = shift_latencies_to_agreed_clock_and_note(told)
    return dict(zip(all_of, moved, strict=True)), notes


def test_an_imu_is_late_where_gnss_and_wheel_agree_on_an_earlier_time() -> None:
    """-100 +- 10 and -110 +- 20 ms: weights 4 to 1, so the IMU is late by 102 ms +- 8.94."""
    found, (note,) = agreed(said(gnss=(-100.0, 10.0), wheel=(-110.0, 20.0)))
    assert found["imu"].status is LatencyStatus.APPLIED
    assert found["imu"].applied_s == pytest.approx(0.102)
    assert found["imu"].sigma_s == pytest.approx(8.944e-3, rel=1e-3)
    assert found["gnss"] == found["wheel"] == Latency(LatencyStatus.REFERENCE)
    assert "gnss, wheel: 102 ms ahead of imu, so imu is late" in note


def test_a_source_that_was_on_the_imus_clock_is_late_with_it() -> None:
    found, _ = agreed(said(gnss=(-100.0, 10.0), wheel=(-100.0, 10.0), compass=(5.0, 5.0)))
    assert found["compass"].status is LatencyStatus.APPLIED
    assert found["compass"].applied_s == pytest.approx(0.105)


@pytest.mark.parametrize("source", ["gnss", "wheel", "compass"])
def test_a_source_that_leads_the_imu_alone_is_believed(source: str) -> None:
    """Nothing is measured after its stamp: correcting the source instead would take it to a clock that is late."""
    found, _ = agreed(said(**{source: (-100.0, 10.0)}))
    assert found["imu"].applied_s == pytest.approx(0.1)
    assert found[source] == Latency(LatencyStatus.REFERENCE)


def test_of_two_that_lead_the_imu_apart_the_position_has_the_clock() -> None:
    found, _ = agreed(said(wheel=(-300.0, 10.0), gnss=(-100.0, 10.0)))
    assert found["imu"].applied_s == pytest.approx(0.1)
    assert found["wheel"].found_s == pytest.approx(-0.2)


@pytest.mark.parametrize(
    "latencies",
    [
        said(gnss=(100.0, 10.0), wheel=(100.0, 10.0)),  # both late: nothing is early
        said(gnss=(-100.0, 10.0), wheel=(0.0, 10.0)),  # the wheel is on the IMU's clock
        said(gnss=(-40.0, 20.0), wheel=(-40.0, 20.0)),  # not clearly there
    ],
    ids=["late", "majority", "unclear"],
)
def test_the_imus_clock_stays(latencies: dict[str, Latency]) -> None:
    found, notes = agreed(latencies)
    assert found == {"imu": Latency(LatencyStatus.REFERENCE), **latencies}
    assert notes == []


def test_a_given_latency_names_the_clock() -> None:
    latencies = {**said(gnss=(-100.0, 10.0)), "wheel": Latency(LatencyStatus.GIVEN, 0.0)}
    assert agreed(latencies)[0]["imu"] == Latency(LatencyStatus.REFERENCE)


def drifting(found_s: float, drift: float, sigma_s: float = 0.01) -> Latency:
    return Latency(LatencyStatus.DRIFTS, found_s, sigma_s, 1e-3, drift=drift, middle_s=120.0)


def test_an_imu_whose_clock_drifts_is_corrected_where_the_others_drift_alike() -> None:
    latencies = {"gnss": drifting(-0.241, -2.0e-3), "wheel": drifting(-0.244, -2.1e-3)}
    found, notes = agreed(latencies)
    assert found["imu"].status is LatencyStatus.DRIFTS
    assert found["imu"].found_s == pytest.approx(0.2425)
    assert found["imu"].drift == pytest.approx(2.05e-3)
    assert found["imu"].middle_s == pytest.approx(120.0)
    assert found["gnss"] == found["wheel"] == Latency(LatencyStatus.REFERENCE)
    assert len(notes) == 1


def test_a_source_that_drifts_late_has_a_clock_of_its_own() -> None:
    latencies = {"gnss": drifting(0.241, 2e-3)}
    assert agreed(latencies) == ({"imu": Latency(LatencyStatus.REFERENCE), **latencies}, [])


def test_a_drift_does_not_agree_with_a_constant() -> None:
    latencies = {"gnss": drifting(-0.241, -2e-3), **said(wheel=(-241.0, 10.0))}
    found, _ = agreed(latencies)
    assert found["gnss"] == Latency(LatencyStatus.REFERENCE)
    assert found["imu"].drift == pytest.approx(2e-3)
    assert found["wheel"] != Latency(LatencyStatus.REFERENCE)
