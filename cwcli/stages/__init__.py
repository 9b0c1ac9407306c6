"""The stages: one line each here, and one file each in this folder.

A stage is a pure function from a log and a configuration to new channels, tables and a summary. It binds roles to
channels, loads the columns it needs, calls one domain room and names what comes out. It writes no file, prints nothing,
and judges nothing: `cwcli.logs.write`, `cwcli.cli` and `cwcli.evaluation` do. Importing this table imports no stage.
"""

from __future__ import annotations

from cwcli.pipeline.stage import Stage

STAGES: dict[str, Stage] = {
    stage.name: stage
    for stage in (
        Stage(
            "estimate",
            "Estimate the states of the ego and the remote vehicles.",
            required=("ego_position",),
            used=("ego_velocity", "ego_speed", "ego_heading", "imu", "remote", "truth"),
            evaluation="cwcli.evaluation.estimate",
        ),
        Stage(
            "track",
            "Track other road users from lidar and radar detections.",
            required=("detections",),
            used=("ego_state", "target_truth"),
            evaluation="cwcli.evaluation.track",
        ),
        Stage(
            "lanes",
            "Find the lane boundaries in camera frames.",
            required=("camera",),
            used=("camera_info", "ego_state", "ego_speed", "imu"),
            evaluation="cwcli.evaluation.lanes",
        ),
        Stage(
            "observe",
            "Observe lateral speed and yaw rate from the lane.",
            required=("lanes",),
            one_of=(("ego_speed", "ego_state", "ego_velocity"),),
            used=("imu", "ego_steer", "lateral_truth"),
            evaluation="cwcli.evaluation.observe",
        ),
        Stage(
            "predict",
            "Predict the vehicles' paths from their states.",
            required=("ego_state",),
            used=("remote_state",),
            evaluation="cwcli.evaluation.predict",
        ),
        Stage(
            "predict-lane",
            "Predict the ego's path from its observed lateral motion.",
            required=("observer",),
            used=("ego_state", "camera", "truth", "lateral_truth"),
            instead_of="predict",
            evaluation="cwcli.evaluation.predict_lane",
        ),
        Stage(
            "warn",
            "Warn of collisions from the predicted paths.",
            required=("ego_state", "ego_path", "remote_state", "remote_path"),
            evaluation="cwcli.evaluation.warn",
        ),
        Stage(
            "warn-targets",
            "Warn of collisions with tracked targets.",
            required=("ego_state", "ego_path", "targets"),
            instead_of="warn",
            evaluation="cwcli.evaluation.warn",
        ),
        Stage(
            "warn-lane",
            "Warn of leaving the lane.",
            required=("observer_path", "lanes"),
            instead_of="warn",
            evaluation="cwcli.evaluation.warn",
        ),
        Stage(
            "measure",
            "Measure how critical the ego and the others were to each other.",
            required=("ego_state",),
            one_of=(("remote_state", "targets"),),
            on_request=True,
            evaluation="cwcli.evaluation.measure",
        ),
        Stage(
            "control",
            "Replay each warning with a braking controller at the pedals.",
            required=("ego_state", "remote_state"),
            on_request=True,
            first=("estimate",),
        ),
    )
}
"""Name -> stage, in the order in which they run."""
DEFAULT_STAGES = tuple(name for name, stage in STAGES.items() if stage.is_default)
"""The stages that `cwcli run` runs without `--stage`; replaying warnings with a controller, for example, is not one."""
