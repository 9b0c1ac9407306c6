"""The V2X link: the messages of the other vehicles that the host receives.

song2016 sends each car's own filter output. Here the sent state is the truth with the noise of the paper's table 1,
column "estimated": white, Gaussian, independent in time (the real error of a filter is correlated; see
docs/papers/song2016-scenarios.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.bsm_sender import (
    ACCEL_FILTER_STEP_S,
    apply_senders_acceleration_low_pass,
    freeze_heading_at_standstill,
)
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.vehicle_state import ACCEL, HEADING, SPEED
from cwcli.simulation.streams import RunSpan, draw_message_schedule, random_stream
from cwcli.simulation.truth import Motion


@dataclass(frozen=True)
class ReceivedMessages:
    """The messages of one vehicle that reached the host, in the order of their reception.

    Attributes:
        vehicle: Name of the vehicle in the scenario.
        station_id: Eight hexadecimal digits.
        stamp_ns: Shape (n,): generation time, ns since 1970.
        log_time_ns: Shape (n,): reception time.
        count: Shape (n,): the sender's message number, from 0; gaps show losses, a smaller number after a larger one
            shows that a message overtook another.
        state: Shape (n, 6): x_m, y_m (map frame), speed_mps, heading_rad, accel_mps2, yaw_rate_radps.
        sigma: Shape (6,): standard deviation of the noise of each.
        lateral_accel_mps2: Shape (n,): speed * yaw rate as sent, positive to the left.
        length_m, width_m: Outline.
        n_lost: Messages that were sent and not received.
    """

    vehicle: str
    station_id: str
    stamp_ns: Int64Array
    log_time_ns: Int64Array
    count: Int64Array
    state: FloatArray
    sigma: FloatArray
    lateral_accel_mps2: FloatArray
    length_m: float
    width_m: float
    n_lost: int


def simulate_received_messages(
    vehicle: str,
    motion: Motion,
    settings: Mapping[str, Any],
    run: RunSpan,
    *,
    station_id: str,
    length_m: float,
    width_m: float,
) -> ReceivedMessages:
    """Simulate the messages of one vehicle that the host receives.

    Args:
        vehicle: Name of the vehicle, which selects the random streams with the seed.
        settings: As checked by `spec.V2X_KEYS`.
        station_id, length_m, width_m: Id and size that the vehicle sends.
    """
    seed, start_ns = run.seed, run.start_ns
    plan = draw_message_schedule(settings, end_s=run.end_s, seed=seed, names=(vehicle, "v2x"))
    sigma = np.array(
        [
            settings["position_sigma_m"],
            settings["position_sigma_m"],
            settings["speed_sigma_mps"],
            np.radians(settings["heading_sigma_deg"]),
            settings["accel_sigma_mps2"],
            np.radians(settings["yaw_rate_sigma_dps"]),
        ]
    )
    true_s = plan.time_s - settings["latency_s"]
    truth = motion.states_at(true_s)[:, :6]
    is_j2945 = settings["sender"] == "j2945"
    if is_j2945:
        truth[:, ACCEL] = _sender_filtered_accel_mps2(motion, true_s)
    sent = truth + sigma * random_stream(seed, vehicle, "v2x", "noise").standard_normal(truth.shape)
    if is_j2945:
        sent[:, HEADING] = freeze_heading_at_standstill(sent[:, HEADING], sent[:, SPEED])
    is_sent = motion.is_present_at(true_s)
    order = np.argsort(plan.arrival_ns, kind="stable")
    order = order[(plan.is_heard & is_sent)[order]]
    return ReceivedMessages(
        vehicle=vehicle,
        station_id=station_id,
        stamp_ns=start_ns + plan.stamp_ns[order],
        log_time_ns=start_ns + plan.arrival_ns[order],
        count=order.astype(np.int64),
        state=sent[order],
        sigma=sigma,
        lateral_accel_mps2=sent[order, 2] * sent[order, 5],
        length_m=length_m,
        width_m=width_m,
        n_lost=int(np.count_nonzero(is_sent & ~plan.is_heard)),
    )


def _sender_filtered_accel_mps2(motion: Motion, at_s: FloatArray) -> FloatArray:
    """The acceleration after the sender's low-pass filter at times (n,), m/s^2; it filters from the run's start."""
    if not len(at_s):
        return np.zeros(0)
    time_s = np.arange(min(0.0, float(at_s.min())), float(at_s.max()) + ACCEL_FILTER_STEP_S, ACCEL_FILTER_STEP_S)
    return np.asarray(np.interp(at_s, time_s, apply_senders_acceleration_low_pass(motion.states_at(time_s)[:, ACCEL])))
