"""The paper's chain and ours on the same simulated drives: sensors -> states -> paths."""

from __future__ import annotations

import math

import numpy as np

from cwcli.estimation.config import EstimatorConfig, LatencyOption
from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.result import Track
from cwcli.estimation.song2016 import (
    SAMPLING_TIME_S,
    filtered_states_and_covariances_of_matrix,
    least_squares_slope_of_last_samples,
)
from cwcli.estimation.track import estimate_track
from cwcli.lazy_dataclass import dataclass
from cwcli.pipeline.paths import PATH_TIME_BEYOND_HORIZON_S
from cwcli.prediction.models import DEFAULT_MODEL
from cwcli.prediction.outcome_history import PathStarts, measure_acting_time_s
from cwcli.prediction.paths import Paths
from cwcli.prediction.rollout import RolloutSettings, roll_out_paths
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.simulation.drive import SimulatedDrive
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario
from cwcli.simulation.sensors import simulate_sensor_messages
from cwcli.simulation.streams import RunSpan
from cwcli.stages.inputs.vehicles import MANOEUVRE_ONSET_MODEL_NAME
from cwcli.warning.types import VehicleTrack

SENSOR_PERIOD_NS = 50_000_000
"""Period of the sensors, in ns: 20 Hz."""
PREDICTION_HORIZON_S = 2.5
"""How far ahead the paper predicts, in s (song2016, section 4)."""
MODEL_BY_FAMILY = {"speed": "cv", "acceleration": "ctra", "jerk": "cj-cya"}
"""The paper's three families of models (eq. 9, 2, 10) -> our names of these models."""


VECTOR_COLUMNS_BY_KIND = {
    Kind.POSITION: [0, 1],
    Kind.SPEED: [2],
    Kind.HEADING: [3],
    Kind.ACCEL: [4],
    Kind.YAW_RATE: [5],
}
"""Kind of measurement -> its columns of the measurement vector Z (eq. 1)."""


@dataclass(frozen=True)
class MeasuredRun:
    """One vehicle of one seed, at the common 20 Hz stamps of its sensors.

    Attributes:
        time_s: Shape (n,).
        truth: Shape (n, 8).
        vectors: Shape (n, 6): the measurement vector Z of eq. 1.
        sigma: Shape (6,): its noise.
    """

    time_s: FloatArray
    truth: FloatArray
    vectors: FloatArray
    sigma: FloatArray


def measure_vehicle(scenario: Scenario, vehicle: str, seed: int) -> MeasuredRun:
    """Measure the paper's synchronous vector (eq. 1) of one vehicle with the scenario's sensors."""
    motion = scenario.vehicles[vehicle].motion
    data = {
        name: simulate_sensor_messages(
            name, motion, settings, run=RunSpan(0, scenario.duration_s, seed), vehicle=vehicle
        )
        for name, settings in scenario.sensors.items()
    }
    columns = (("gnss", 0), ("gnss", 1), ("speed", 0), ("gnss_heading", 0), ("imu", 0), ("imu", 5))
    n = min(len(data[name].values) for name, _ in columns)
    vectors = np.column_stack([data[name].values[:n, column] for name, column in columns])
    sigma = np.array([data[name].sigma[column] for name, column in columns])
    time_s = np.asarray(data["gnss"].stamp_ns[:n] * 1e-9, dtype=np.float64)
    return MeasuredRun(time_s, motion.states_at(time_s), vectors, sigma)


def paper_filter_states_with_derivatives(run: MeasuredRun) -> FloatArray:
    """Run song2016's filter (eq. 8) and add the derivatives that its prediction needs, shape (n, 8)."""
    states, _ = filtered_states_and_covariances_of_matrix(run.vectors, tuple(run.sigma))
    return np.column_stack(
        [
            states[:, :6],
            least_squares_slope_of_last_samples(states[:, 4]),
            least_squares_slope_of_last_samples(states[:, 5]),
        ]
    )


def estimate_our_track(run: MeasuredRun, *, causal: bool = True, latency: LatencyOption = "none") -> Track:
    """Run our default estimator on the same measurements, with the same noise given.

    Args:
        run: The measurements; their stamps are right.
        causal: The filter alone.
        latency: "auto": latencies are searched, as the command line does.
    """
    stamp_ns = np.arange(len(run.vectors), dtype=np.int64) * SENSOR_PERIOD_NS
    measurements = [
        _measurements_of_kind(kind, stamp_ns, run.vectors[:, own], run.sigma[own])
        for kind, own in VECTOR_COLUMNS_BY_KIND.items()
    ]
    return estimate_track(measurements, EstimatorConfig(latency=latency, causal=causal), stamp_ns)


@dataclass(frozen=True)
class KnownVehicle:
    """One vehicle as our default chain knows it online, from the past alone.

    Attributes:
        name: `host` or the station id.
        track: Causal estimate: at 20 Hz for the host, at the times of its messages for another.
        log_time_ns: Shape (n,): when each state was known to the host.
    """

    name: str
    track: Track
    log_time_ns: Int64Array
    horizon_s: float
    length_m: float
    width_m: float

    def with_predicted_paths(self, model: str, *, with_onset: bool = False) -> VehicleTrack:
        """Predict a path from every state by a key of `MODELS`, and the onset hypothesis if asked."""
        return VehicleTrack(
            self.name,
            self.track.stamp_ns,
            self.log_time_ns,
            self.track.state,
            self._predict_paths(model),
            self.length_m,
            self.width_m,
            self._predict_paths(MANOEUVRE_ONSET_MODEL_NAME) if with_onset else None,
            self.track.flags,
        )

    def _predict_paths(self, model: str) -> Paths:
        """Predict a path from every state."""
        acted = online_acting_durations_s(self.track, self.log_time_ns) if model == DEFAULT_MODEL else None
        state, covariance = self.track.state, self.track.covariance
        return roll_out_paths(
            model,
            state,
            covariance,
            settings=RolloutSettings(horizon_s=self.horizon_s, step_s=SAMPLING_TIME_S),
            acting_s=acted,
        )


def online_acting_durations_s(track: Track, log_time_ns: Int64Array | None = None) -> FloatArray:
    """Return for how long derivatives act by the vehicle's own record, as in `predict`; for our default model."""
    vehicle = np.zeros(len(track.state), np.int64)
    return measure_acting_time_s(PathStarts(vehicle, track.stamp_ns, track.state, track.covariance, log_time_ns))


def vehicle_known_without_delay(run: MeasuredRun, name: str) -> KnownVehicle:
    """Return a vehicle whose filtered state the host knows at once, as the paper assumes; the filter is ours."""
    track = estimate_our_track(run)
    return KnownVehicle(
        name, track, track.stamp_ns, PREDICTION_HORIZON_S + PATH_TIME_BEYOND_HORIZON_S, math.nan, math.nan
    )


def host_and_received_vehicles(drive: SimulatedDrive) -> tuple[KnownVehicle, list[KnownVehicle]]:
    """Estimate the host from its sensors, and the others from the messages that it received of them.

    Args:
        drive: A simulated drive with at least one other vehicle on V2X.
    """
    first_ns = max(int(data.stamp_ns.min()) for data in drive.sensors.values())
    last_ns = min(int(data.stamp_ns.max()) for data in drive.sensors.values())
    grid_ns = np.arange(first_ns, last_ns + 1, SENSOR_PERIOD_NS, dtype=np.int64)
    config = EstimatorConfig(latency="none", causal=True)
    sizes = drive.scenario.vehicles[EGO_VEHICLE_KEY]
    track = estimate_track(_host_measurements_by_sensor(drive), config, grid_ns)
    host = KnownVehicle(EGO_VEHICLE_KEY, track, grid_ns, PREDICTION_HORIZON_S, sizes.length_m, sizes.width_m)
    others = []
    for received in drive.v2x.values():
        stamp_ns, rows = np.unique(received.stamp_ns, return_index=True)
        said = [
            _measurements_of_kind(kind, stamp_ns, received.state[rows][:, own], received.sigma[own])
            for kind, own in VECTOR_COLUMNS_BY_KIND.items()
        ]
        others.append(
            KnownVehicle(
                received.station_id,
                estimate_track(said, config, stamp_ns),
                received.log_time_ns[rows],
                PREDICTION_HORIZON_S + PATH_TIME_BEYOND_HORIZON_S,
                received.length_m,
                received.width_m,
            )
        )
    return host, others


def _host_measurements_by_sensor(drive: SimulatedDrive) -> list[Measurements]:
    """Return the measurements of the host's sensors."""
    sensors = drive.sensors
    gnss, imu = sensors["gnss"], sensors["imu"]
    return [
        _measurements_of_kind(Kind.POSITION, gnss.stamp_ns, gnss.values[:, :2], gnss.sigma[:2]),
        _measurements_of_kind(Kind.SPEED, sensors["speed"].stamp_ns, sensors["speed"].values, sensors["speed"].sigma),
        _measurements_of_kind(
            Kind.HEADING,
            sensors["gnss_heading"].stamp_ns,
            sensors["gnss_heading"].values,
            sensors["gnss_heading"].sigma,
        ),
        Measurements("imu", Kind.IMU, imu.stamp_ns, imu.values, np.tile(np.square(imu.sigma), (len(imu.values), 1))),
    ]


def _measurements_of_kind(kind: Kind, stamp_ns: Int64Array, values: FloatArray, sigma: FloatArray) -> Measurements:
    """Return values as measurements of a kind."""
    return Measurements(kind.name.lower(), kind, stamp_ns, values, np.tile(np.square(sigma), (len(values), 1)))


def paper_predicted_points_m(states: FloatArray, family: str, horizon_s: float) -> FloatArray:
    """Predict positions `horizon_s` ahead by the paper's recursion (eq. 9, 2 or 10), shape (n, 2), m."""
    paths = roll_out_paths(
        MODEL_BY_FAMILY[family],
        states,
        None,
        settings=RolloutSettings(horizon_s=horizon_s, step_s=SAMPLING_TIME_S, discretisation="paper"),
    )
    return np.column_stack([paths.x_m[:, -1], paths.y_m[:, -1]])
