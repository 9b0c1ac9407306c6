"""What README.md compares cwcli with: the same question asked with `mcap`, `pandas`, `pyproj` and `evo`.

python docs/without_cwcli.py sample_logs/intersection.mcap

It knows this log: its topics, units, message types and clocks. It filters nothing, finds no latency, bias or outlier,
knows no covariance, and writes nothing back into the log. It needs mcap, mcap-ros2-support, mcap-protobuf-support,
pandas, pyproj, evo.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from evo.core import metrics
from evo.core.trajectory import PosePath3D
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufFactory
from mcap_ros2.decoder import DecoderFactory as Ros2Factory
from pyproj import Transformer

HORIZON_S, DISTANCE_M = 2.5, 2.5


def read_topics(path: Path) -> dict[str, pd.DataFrame]:
    """Return each topic as a table; `t` is the time of the measurement in s."""
    rows: dict[str, list[dict]] = {"fix": [], "speed": [], "heading": [], "other": [], "truth": []}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[Ros2Factory(), ProtobufFactory()])
        for _, _, message in reader.iter_messages(topics=["/v2x/bsm"]):
            core = json.loads(message.data)["coreData"]
            rows["other"].append(
                {
                    "t": message.log_time / 1e9,  # the stamp is a second of the minute, and needs more lines
                    "lat": core["lat"] * 1e-7,
                    "lon": core["long"] * 1e-7,
                    "speed": core["speed"] * 0.02,
                    "heading": np.deg2rad(90.0 - core["heading"] * 0.0125),
                }
            )
        topics = ["/gps/fix", "/gps/heading", "/vehicle/velocity", "/truth/ego"]
        for _, channel, _, msg in reader.iter_decoded_messages(topics=topics):
            if channel.topic == "/truth/ego":
                rows["truth"].append({"t": msg.stamp_ns / 1e9, "lat": msg.latitude_deg, "lon": msg.longitude_deg})
                continue
            t = msg.header.stamp.sec + msg.header.stamp.nanosec / 1e9
            if channel.topic == "/gps/fix":
                rows["fix"].append({"t": t, "lat": msg.latitude, "lon": msg.longitude})
            elif channel.topic == "/gps/heading":
                q = msg.quaternion
                rows["heading"].append({"t": t, "heading": 2.0 * np.arctan2(q.z, q.w)})
            else:
                rows["speed"].append({"t": t, "speed": msg.longitudinal_velocity})
    return {name: pd.DataFrame(each).sort_values("t") for name, each in rows.items()}


def add_xy(tables: dict[str, pd.DataFrame]) -> None:
    """Add x (east) and y (north) in m to the tables with places."""
    first = tables["fix"].iloc[0]
    to_plane = Transformer.from_crs("EPSG:4326", f"+proj=tmerc +lat_0={first.lat} +lon_0={first.lon} +ellps=WGS84")
    for table in tables.values():
        if "lat" in table:
            table["x"], table["y"] = to_plane.transform(table.lat.to_numpy(), table.lon.to_numpy())


def position_rmse_m(ego: pd.DataFrame, truth: pd.DataFrame) -> float:
    """Return the RMSE of the position against the truth, by evo."""
    both = pd.merge_asof(ego, truth, on="t", direction="nearest", suffixes=("", "_true"))
    paths = []
    for x, y in ((both.x_true, both.y_true), (both.x, both.y)):
        places = np.column_stack([x, y, np.zeros(len(both))])
        paths.append(PosePath3D(positions_xyz=places, orientations_quat_wxyz=np.tile([1.0, 0, 0, 0], (len(both), 1))))
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data(tuple(paths))
    return float(error.get_statistic(metrics.StatisticsType.rmse))


def first_warning_s(ego: pd.DataFrame, other: pd.DataFrame) -> float | None:
    """Return the first time at which constant velocities bring the centres nearer than DISTANCE_M."""
    both = pd.merge_asof(ego, other, on="t", direction="backward", suffixes=("", "_other")).dropna()
    apart = both[["x_other", "y_other"]].to_numpy() - both[["x", "y"]].to_numpy()
    speeds = [
        np.column_stack(
            [both[f"speed{end}"] * np.cos(both[f"heading{end}"]), both[f"speed{end}"] * np.sin(both[f"heading{end}"])]
        )
        for end in ("_other", "")
    ]
    closing = speeds[0] - speeds[1]
    steps = np.arange(0.0, HORIZON_S, 0.05)
    distance = np.linalg.norm(apart[:, None] + closing[:, None] * steps[None, :, None], axis=2).min(axis=1)
    hits = np.flatnonzero(distance < DISTANCE_M)
    return float(both.t.iloc[hits[0]]) if len(hits) else None


tables = read_topics(Path(sys.argv[1]))
add_xy(tables)
ego = tables["fix"]
for name in ("speed", "heading"):
    ego = pd.merge_asof(ego, tables[name], on="t", direction="nearest")
print(f"position RMSE {position_rmse_m(ego, tables['truth']):.3f} m")
at = first_warning_s(ego, tables["other"])
print("no warning" if at is None else f"warning at {at - ego.t.iloc[0]:.2f} s")
