"""In the bundled scenarios in which two vehicles touch, each measure is most critical about the contact."""

from __future__ import annotations

from functools import cache

import pytest

from tests.studies.measure_pictures import SCENARIOS, Measured, measured

BEFORE_S, AFTER_S = 1.3, 0.8
"""What asks for a manoeuvre is most critical when the last one is lost, up to a second before."""
ABOUT = ("gap", "ttc", "mttc", "ttc-star", "headway", "thw", "wttc", "ttb", "tts", "ttr", "drac", "mdrac",
         "contact-psd", "msd", "stn", "delta-v", "a-lat-req")  # fmt: skip
STEADY = "the host's speed is constant: the noise of its states decides"
ELSEWHERE = {
    "cut-in": {"gap": "the two drive on", "delta-v": "the headings differ most in the lane change", "msd": STEADY},
    "oncoming-left-turn": {"ttb": "on a collision course only when braking no longer helps", "msd": STEADY},
    "stopped-behind-curve": {"msd": STEADY},
}
"""Scenario -> measure -> why it is not most critical about the contact."""
BEHIND = ("rear-end", "cut-in", "stopped-behind-curve")
FOLLOWING = ("btn", "a-long-req", "a-req", "rss-long")
FORESEEN = ("dce", "ttce")
"""Predictions at constant speed: of two that close up all the time they say 0 long before."""


@cache
def of(scenario: str) -> Measured:
    return measured(scenario)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_measures_peak_about_the_contact(scenario: str) -> None:
    found = of(scenario)
    names = {*ABOUT, *(FOLLOWING if scenario in BEHIND else ("ttk", "gap-time"))} - ELSEWHERE.get(scenario, {}).keys()
    peaks = {name: found.peak_s(name) - found.contact_s for name in names}
    assert {name: peak for name, peak in peaks.items() if not -BEFORE_S <= peak <= AFTER_S} == {}


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_prediction_may_know_it_long_before(scenario: str) -> None:
    found = of(scenario)
    assert all(found.peak_s(name) <= found.contact_s for name in FORESEEN)
