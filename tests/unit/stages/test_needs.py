"""What a log is good for, from the roles that it fills, and whether the stages agree."""

import pytest

from cwcli.pipeline.needs import readiness_of_each_stage
from cwcli.stages import STAGES


def by_stage(*bound: str) -> dict[str, tuple[bool, tuple[str, ...], tuple[str, ...]]]:
    return {
        entry.stage.name: (entry.is_ready, entry.after, entry.missing)
        for entry in readiness_of_each_stage(bound, STAGES)
    }


@pytest.mark.parametrize(
    ("bound", "expected"),
    [
        (
            ("ego_position", "remote"),
            {
                "estimate": (True, (), ()),
                "predict": (False, ("estimate",), ()),
                "warn": (False, ("estimate", "predict"), ()),
            },
        ),
        (
            ("ego_position",),
            {
                "estimate": (True, (), ()),
                "predict": (False, ("estimate",), ()),
                "warn": (False, (), ("remote",)),
            },
        ),
        (
            ("camera",),
            {
                "estimate": (False, (), ("ego_position",)),
                "predict": (False, (), ("ego_position",)),
                "warn": (False, (), ("ego_position", "remote")),
            },
        ),
        (
            ("ego_position", "ego_state", "remote_state"),
            {
                "estimate": (True, (), ()),
                "predict": (True, (), ()),
                "warn": (False, ("predict",), ()),
            },
        ),
        (
            ("ego_state", "remote_state", "ego_path", "remote_path"),
            {"estimate": (False, (), ("ego_position",)), "predict": (True, (), ()), "warn": (True, (), ())},
        ),
        (("detections",), {"track": (True, (), ()), "predict": (False, (), ("ego_position",))}),
        (("ego_position",), {"track": (False, (), ("detections",))}),
        (
            ("camera", "ego_speed"),
            {
                "lanes": (True, (), ()),
                "observe": (False, ("lanes",), ()),
                "predict-lane": (False, ("lanes", "observe"), ()),
                "warn-lane": (False, ("lanes", "observe", "predict-lane"), ()),
                "warn": (False, (), ("ego_position", "remote")),
            },
        ),
        (("lanes", "ego_state"), {"observe": (True, (), ())}),
        (("lanes", "ego_velocity"), {"observe": (True, (), ())}),
        (("camera", "ego_position"), {"observe": (False, ("estimate", "lanes"), ())}),
        (("lanes",), {"observe": (False, (), ("ego_speed",))}),
        (
            ("lanes", "observer_path"),
            {"warn": (False, (), ("ego_position", "remote")), "warn-lane": (True, (), ())},
        ),
        (
            ("ego_position", "detections"),
            {
                "warn-targets": (False, ("estimate", "track", "predict"), ()),
                "warn": (False, (), ("remote",)),
            },
        ),
    ],
    ids=[
        "drive",
        "ego-only",
        "camera-only",
        "estimated",
        "predicted",
        "detections",
        "no-detections",
        "camera-and-speed",
        "speed-from-states",
        "speed-over-ground",
        "speed-from-estimate",
        "no-speed",
        "lane-departure",
        "targets",
    ],
)
def test_readiness(bound: tuple[str, ...], expected: dict[str, tuple[bool, tuple[str, ...], tuple[str, ...]]]) -> None:
    found = by_stage(*bound)
    assert {stage: found[stage] for stage in expected} == expected


def test_readiness_names_what_a_stage_would_use() -> None:
    estimate = readiness_of_each_stage(("ego_position", "imu"), STAGES)[0]
    assert estimate.unused == ("ego_velocity", "ego_speed", "ego_heading", "remote", "truth")
