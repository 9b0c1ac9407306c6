"""The simulation of a scenario with a seed: truth, measurements and received messages as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from cwcli.lazy_dataclass import dataclass
from cwcli.simulation.detectors import DetectionScans, simulate_detections
from cwcli.simulation.scenario import EGO_VEHICLE_KEY, Scenario
from cwcli.simulation.sensors import SensorData, simulate_sensor_messages
from cwcli.simulation.spec import DETECTOR_KEYS, SENSOR_KEYS
from cwcli.simulation.streams import RunSpan
from cwcli.simulation.v2x_link import ReceivedMessages, simulate_received_messages


@dataclass(frozen=True)
class SimulatedDrive:
    """A simulated drive: the truth and the messages that the host received.

    Attributes:
        scenario: The scenario.
        seed: Seed of all draws.
        sensors: Sensor name -> the host's measurements.
        v2x: Vehicle name -> the messages that the host received from it.
        detections: `lidar`, `radar` -> what the host's sensor detected of the other vehicles.
    """

    scenario: Scenario
    seed: int
    sensors: Mapping[str, SensorData]
    v2x: Mapping[str, ReceivedMessages]
    detections: Mapping[str, DetectionScans]


def simulate_scenario(scenario: Scenario, seed: int | None = None) -> SimulatedDrive:
    """Simulate a scenario once.

    Args:
        seed: Seed of all draws; None takes the scenario's own. The truth doesn't depend on it.
    """
    chosen = scenario.seed if seed is None else seed
    end_s = scenario.duration_s
    host = scenario.vehicles[EGO_VEHICLE_KEY]
    sensors = {
        name: simulate_sensor_messages(
            name,
            host.motion,
            settings,
            run=RunSpan(scenario.start_ns, end_s, chosen),
            vehicle=EGO_VEHICLE_KEY,
            attitude=host.attitude,
        )
        for name, settings in scenario.sensors.items()
        if name in SENSOR_KEYS
    }
    others = [vehicle.motion for name, vehicle in scenario.vehicles.items() if name != EGO_VEHICLE_KEY]
    detections = {
        name: simulate_detections(name, host.motion, others, settings, RunSpan(scenario.start_ns, end_s, chosen))
        for name, settings in scenario.sensors.items()
        if name in DETECTOR_KEYS
    }
    received = {}
    if scenario.v2x is not None:
        for name, vehicle in scenario.vehicles.items():
            if name != EGO_VEHICLE_KEY and vehicle.has_v2x:
                received[name] = simulate_received_messages(
                    name,
                    vehicle.motion,
                    scenario.v2x,
                    station_id=vehicle.station_id,
                    length_m=vehicle.length_m,
                    width_m=vehicle.width_m,
                    run=RunSpan(scenario.start_ns, end_s, chosen),
                )
    return SimulatedDrive(
        scenario=scenario,
        seed=chosen,
        sensors=MappingProxyType(sensors),
        v2x=MappingProxyType(received),
        detections=MappingProxyType(detections),
    )
