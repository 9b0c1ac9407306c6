"""What a log is good for, from the roles that it fills."""

import pytest

from cwcli.stages.needs import NEEDS, readiness


def by_stage(*bound: str) -> dict[str, tuple[bool, tuple[str, ...], tuple[str, ...]]]:
    return {entry.stage: (entry.is_ready, entry.after, entry.missing) for entry in readiness(bound)}


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
    ],
    ids=["drive", "ego-only", "camera-only", "estimated", "predicted", "detections", "no-detections"],
)
def test_readiness(bound: tuple[str, ...], expected: dict[str, tuple[bool, tuple[str, ...], tuple[str, ...]]]) -> None:
    found = by_stage(*bound)
    assert {stage: found[stage] for stage in expected} == expected


def test_readiness_names_what_a_stage_would_use() -> None:
    estimate = readiness(("ego_position", "imu"))[0]
    assert estimate.unused == ("ego_velocity", "ego_speed", "ego_heading", "remote", "truth")


def test_needs_name_roles() -> None:
    from cwcli.signals.roles import Role

    known = {role.value for role in Role}
    for need in NEEDS.values():
        assert {*need.required, *need.used, *need.added, *need.added.values()} <= known
