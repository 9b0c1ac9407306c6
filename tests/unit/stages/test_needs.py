"""What a log is good for, from the roles that it fills, and whether the stages agree."""

import pytest

from cwcli.pipeline.needs import NEEDS, STAGES, readiness


def by_command(*bound: str) -> dict[str, tuple[bool, tuple[str, ...], tuple[str, ...]]]:
    return {entry.command: (entry.is_ready, entry.after, entry.missing) for entry in readiness(bound)}


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
                "predict --from observer": (False, ("lanes", "observe"), ()),
                "warn --rules lane-departure": (False, ("lanes", "observe", "predict --from observer"), ()),
                "warn": (False, (), ("ego_position", "remote")),
            },
        ),
        (("lanes", "ego_state"), {"observe": (True, (), ())}),
        (("lanes", "ego_velocity"), {"observe": (True, (), ())}),
        (("camera", "ego_position"), {"observe": (False, ("estimate", "lanes"), ())}),
        (("lanes",), {"observe": (False, (), ("ego_speed",))}),
        (
            ("lanes", "observer_path"),
            {"warn": (False, (), ("ego_position", "remote")), "warn --rules lane-departure": (True, (), ())},
        ),
        (
            ("ego_position", "detections"),
            {
                "warn --source targets": (False, ("estimate", "track", "predict"), ()),
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
    found = by_command(*bound)
    assert {stage: found[stage] for stage in expected} == expected


def test_readiness_names_what_a_stage_would_use() -> None:
    estimate = readiness(("ego_position", "imu"))[0]
    assert estimate.unused == ("ego_velocity", "ego_speed", "ego_heading", "remote", "truth")


def test_needs_name_roles() -> None:
    from cwcli.channels.binding import EVERY_ROLE

    known = set(EVERY_ROLE)
    for need in NEEDS.values():
        named = {role for group in need.groups for role in group}
        assert {*named, *need.used, *need.added, *need.added.values()} <= known


def test_commands_are_in_the_order_in_which_run_runs_them() -> None:
    from cwcli.cli.commands.run import default_options

    assert list(STAGES) == list(default_options().of_stages)
