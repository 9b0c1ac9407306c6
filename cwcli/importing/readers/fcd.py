"""SUMO's floating car data: the positions of all vehicles at each step.

One vehicle is the ego: its positions, speeds and angles become sensor channels. The others become V2X messages (BSM),
as if each sent at each step. Angles are degrees clockwise from north, positions those of the front bumper. A plane
without a place on the globe is put at `PLANE_ORIGIN_LATITUDE_LONGITUDE_DEG`.
Source: sumo.dlr.de/docs/Simulation/Output/FCDOutput.html.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cwcli.errors import DataError, InputError
from cwcli.importing.bounded_xml import iter_xml_events
from cwcli.importing.readers.base import FileHead, ImportKind, Recording, WrittenChannel
from cwcli.importing.tables import Answers, Guess, Preset, Question, SourceTable
from cwcli.importing.times import MAX_STAMP_NS
from cwcli.lazy_dataclass import dataclass
from cwcli.logs.write.writer import LogWriter
from cwcli.signals.angles import heading_from_compass_deg
from cwcli.signals.columns import FloatArray, Int64Array
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.units import NS_PER_S
from cwcli.simulate.v2x import BSM_SCHEMA, encode_bsm_json
from cwcli.simulation.v2x_link import ReceivedMessages

PLANE_ORIGIN_LATITUDE_LONGITUDE_DEG = (52.0, 10.0)
"""Latitude and longitude of the origin of a plane that has no place on the globe, degrees; chosen by hand."""
MAX_MAGNITUDE_OF_VEHICLE_ATTRIBUTE_VALUE = 1e10
"""Greatest size of a time, place, angle or speed of a simulated vehicle. Chosen by hand: ten thousand times the size of
a map."""
READ_ATTRIBUTES = ("time", "x", "y", "angle", "speed")
"""The time, and the attributes of a vehicle at a step that are read."""
OTHER_VEHICLES_TOPIC = "/v2x/bsm"
"""Topic of the others' messages."""


def _accepts_fcd_file(head: FileHead) -> bool:
    return "<fcd-export" in "\n".join(head.lines[:60])


def _read_fcd_tables(path: str, answers: Answers) -> Sequence[SourceTable | Recording]:
    vehicles = _read_rows_by_vehicle(path)
    if not vehicles:
        raise DataError("it holds no vehicle", where=path)
    ego = _choose_ego_name(path, list(vehicles), answers)
    tables = {name: np.array(rows, np.float64) for name, rows in vehicles.items()}
    is_geographic = _is_geographic(tables[ego])
    places = {name: _latitudes_and_longitudes(rows, is_geographic) for name, rows in tables.items()}
    origin = LocalMap(*PLANE_ORIGIN_LATITUDE_LONGITUDE_DEG)
    latitude, longitude = places[ego]
    stamps = np.rint(tables[ego][:, 0] * 1e6).astype(np.int64) * 1000
    columns = {
        "time": stamps,
        "lat": latitude,
        "lon": longitude,
        "speed": tables[ego][:, 4],
        "angle": tables[ego][:, 3],
    }
    presets = {
        "time": Preset("time", "ns"),
        "lat": Preset("latitude", "deg"),
        "lon": Preset("longitude", "deg"),
        "speed": Preset("speed", "mps"),
        "angle": Preset("heading", "deg-cw-north"),
    }
    notes = [f"the ego is {ego}; positions are those of front bumpers"]
    if not is_geographic:
        latitude_deg, longitude_deg = PLANE_ORIGIN_LATITUDE_LONGITUDE_DEG
        notes.append(
            f"the plane has no place on the globe: its origin is put at {latitude_deg:g} N {longitude_deg:g} E"
        )
    table = SourceTable.of_arrays(path, ego, "sumo fcd", columns, presets=presets, notes=notes)
    others = {}
    for name, values in tables.items():
        rows = _complete_row_indices_by_time(values)
        if name != ego and len(rows) > 1:
            others[name] = values[rows], (places[name][0][rows], places[name][1][rows])
    return [table, OtherVehicles(path, others, origin)] if others else [table]


def _read_rows_by_vehicle(path: str) -> dict[str, list[tuple[float, ...]]]:
    """Return the rows of each vehicle.

    Raises:
        InputError: It is no XML, or a number is none.
    """
    vehicles: dict[str, list[tuple[float, ...]]] = {}
    time_s = 0.0
    try:
        for event, element in iter_xml_events(path, ()):
            if element.tag == "timestep" and event == "start":
                time_s = _seconds_of_time(element.get("time", "nan"))
                if time_s < 0.0 or MAX_STAMP_NS / NS_PER_S < time_s < np.inf:
                    raise DataError(f"a time step is at {time_s:g} s", where=path, hint="SUMO's times begin at 0")
            elif element.tag == "vehicle" and event == "end":
                row = [float(element.get(name, "nan")) for name in READ_ATTRIBUTES[1:]]
                if np.isfinite([time_s, *row[:2]]).all():
                    vehicles.setdefault(element.get("id", ""), []).append((time_s, *row))
    except ValueError as error:
        raise InputError(f"it can't be read: {error}", where=path) from error
    return vehicles


def _seconds_of_time(text: str) -> float:
    """Return the seconds of a time step: a number, or `day:hh:mm:ss`, the readable time of SUMO."""
    *more, seconds = text.split(":")
    factors = (60.0, 3600.0, 86_400.0)
    if len(more) > len(factors):
        raise ValueError(f"{text!r} is not a time")
    return float(seconds) + sum(float(each) * factor for each, factor in zip(reversed(more), factors, strict=False))


def _complete_row_indices_by_time(rows: FloatArray) -> Int64Array:
    """Return the rows with every value that a message needs, one a time, in the order of time."""
    complete = np.flatnonzero(
        np.isfinite(rows).all(axis=1) & (np.abs(rows) < MAX_MAGNITUDE_OF_VEHICLE_ATTRIBUTE_VALUE).all(axis=1)
    )
    stamps = np.rint(rows[complete, 0] * 1e6).astype(np.int64)
    return complete[np.unique(stamps, return_index=True)[1]]


def _choose_ego_name(path: str, names: Sequence[str], answers: Answers) -> str:
    if answers.vehicle in names:
        return answers.vehicle
    if len(names) == 1:
        return names[0]
    own = [name for name in names if name.lower() in {"ego", "host"}]
    if len(own) == 1 and not answers.vehicle:
        return own[0]
    shown = ", ".join(names[:10]) + (f" and {len(names) - 10} more" if len(names) > 10 else "")
    raise Question(
        path, f"it holds {len(names)} vehicles, and one of them is the ego: {shown}", f"--id {names[0]}"
    ).as_error()


def _is_geographic(rows: FloatArray) -> bool:
    """Tell whether x and y are longitude and latitude: they then change by far less than the speed says."""
    x, y = rows[:, 1], rows[:, 2]
    if np.abs(x).max() > 180.0 or np.abs(y).max() > 90.0 or len(rows) < 2:
        return False
    way = float(np.hypot(np.diff(x), np.diff(y)).sum())
    driven = float((rows[:-1, 4] * np.diff(rows[:, 0])).sum())
    return driven > 0 and way < 0.01 * driven


def _latitudes_and_longitudes(rows: FloatArray, is_geographic: bool) -> tuple[FloatArray, FloatArray]:
    if is_geographic:
        return rows[:, 2], rows[:, 1]
    latitude, longitude, _ = LocalMap(*PLANE_ORIGIN_LATITUDE_LONGITUDE_DEG).wgs84_from_map(
        rows[:, 1], rows[:, 2], np.zeros(len(rows))
    )
    return latitude, longitude


@dataclass(frozen=True)
class OtherVehicles:
    """The other vehicles, each with its rows and its places, as senders of V2X messages."""

    name: str
    vehicles: dict[str, tuple[FloatArray, tuple[FloatArray, FloatArray]]]
    origin: LocalMap

    @property
    def guesses(self) -> Sequence[Guess]:
        """Nothing is guessed."""
        return ()

    @property
    def topics(self) -> Sequence[WrittenChannel]:
        """One channel with the messages of all."""
        n_messages = sum(len(rows) for rows, _ in self.vehicles.values())
        return [WrittenChannel(OTHER_VEHICLES_TOPIC, BSM_SCHEMA["title"], n_messages)]

    def write(self, log: LogWriter) -> None:
        """Write the messages in the order of time."""
        import json

        latitude, longitude = next(iter(self.vehicles.values()))[1]
        local_map = LocalMap(float(latitude[0]), float(longitude[0]))
        messages: list[bytes] = []
        times: list[Int64Array] = []
        for k, (name, (rows, places)) in enumerate(self.vehicles.items()):
            received = _messages_of_vehicle(name, k, rows, places, local_map)
            messages += encode_bsm_json(received, local_map)
            times.append(received.log_time_ns)
        log_time_ns = np.concatenate(times)
        order = np.argsort(log_time_ns, kind="stable")
        schema = log.add_schema(BSM_SCHEMA["title"], "jsonschema", json.dumps(BSM_SCHEMA).encode())
        channel = log.add_channel(OTHER_VEHICLES_TOPIC, "json", schema)
        log.write_messages(channel, log_time_ns[order], [messages[i] for i in order.tolist()])


def _messages_of_vehicle(
    name: str,
    vehicle_index: int,
    rows: FloatArray,
    latitudes_and_longitudes_deg: tuple[FloatArray, FloatArray],
    local_map: LocalMap,
) -> ReceivedMessages:
    """Return the messages that a vehicle would send: one each step."""
    stamps = np.rint(rows[:, 0] * 1e6).astype(np.int64) * 1000
    x, y, _ = local_map.map_from_wgs84(*latitudes_and_longitudes_deg, np.zeros(len(rows)))
    heading = np.unwrap(heading_from_compass_deg(rows[:, 3]))
    time_s = stamps / NS_PER_S
    accel, yaw_rate = np.gradient(rows[:, 4], time_s), np.gradient(heading, time_s)
    return ReceivedMessages(
        vehicle=name,
        station_id=f"{vehicle_index + 1:08x}",
        stamp_ns=stamps,
        log_time_ns=stamps,
        count=np.arange(len(rows), dtype=np.int64),
        state=np.column_stack([x, y, rows[:, 4], heading, accel, yaw_rate]),
        sigma=np.zeros(6),
        lateral_accel_mps2=rows[:, 4] * yaw_rate,
        length_m=5.0,
        width_m=1.8,
        n_lost=0,
    )


KIND = ImportKind("SUMO's floating car data (FCD)", (".xml",), _accepts_fcd_file, _read_fcd_tables)
"""The description of this kind."""
