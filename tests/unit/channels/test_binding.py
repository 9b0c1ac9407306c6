"""Role binding: candidates, ranks, truth topics, overrides, and the words of the errors."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from cwcli.channels.binding import ALL_ROLE_NAMES, Bindings, bind_roles, parse_role_overrides
from cwcli.channels.published import EGO_PATH, EGO_STATE
from cwcli.errors import MissingSignalError, UsageError
from cwcli.signals.inputs import INPUTS_BY_SCHEMA_NAME, find_input_for_role, normalise_schema_name
from cwcli.signals.role import Role


@dataclass(frozen=True)
class Channel:
    topic: str
    schema_name: str
    message_encoding: str = "cdr"
    message_count: int | None = 10


FIX = Channel("/gps/fix", "sensor_msgs/msg/NavSatFix")
VEL = Channel("/gps/vel", "geometry_msgs/msg/TwistWithCovarianceStamped")
TWIST = Channel("/vehicle/twist", "geometry_msgs/msg/TwistStamped")
IMU = Channel("/imu/data", "sensor_msgs/Imu", "json")
CAM = Channel("/v2x/cam", "etsi_its_cam_msgs/msg/CAM")
DENM = Channel("/v2x/denm", "etsi_its_denm_msgs/msg/DENM")
CPM = Channel("/v2x/cpm", "etsi_its_cpm_ts_msgs/msg/CollectivePerceptionMessage")
SDSM = Channel("/v2x/sdsm", "j3224_v2x_msgs/msg/SensorDataSharingMessage")
BSM = Channel("/v2x/bsm", "BasicSafetyMessage", "json")
ODE = Channel("/v2x/ode_bsm", "OdeBsmData", "json")
IMAGE = Channel("/camera/front", "foxglove.CompressedImage", "protobuf")
GROUND_TRUTH = Channel("/sim/ground_truth/odom", "nav_msgs/msg/Odometry")
OWN_FIX = Channel("/cwcli/ego/fix", "foxglove.LocationFix", "protobuf")
EMPTY_FIX = Channel("/gps/fix", "sensor_msgs/msg/NavSatFix", message_count=0)
TRUTH = Channel("/truth/pose", "foxglove.PoseInFrame", "protobuf")
TRUTH_IMU = Channel("/truth/pose_imu", "foxglove.PoseInFrame", "protobuf")
ODOM = Channel("/odom", "nav_msgs/msg/Odometry")


def bound(
    *channels: Channel, overrides: dict[str, str] | None = None, ego_station: str | None = None
) -> dict[str, str]:
    bindings = bind_roles(channels, overrides or {}, required=(), optional=ALL_ROLE_NAMES, ego_station=ego_station)
    return {str(role): ",".join(b.topic for b in bindings.channels_of_role(role)) for role in bindings.by_role}


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        pytest.param(
            (FIX, VEL, IMU), {"ego_position": "/gps/fix", "ego_velocity": "/gps/vel", "imu": "/imu/data"}, id="dresden"
        ),
        pytest.param(
            (CAM, TWIST, FIX),
            {"ego_position": "/gps/fix", "ego_speed": "/vehicle/twist", "remote": "/v2x/cam"},
            id="openacc",
        ),
        pytest.param((DENM, CAM, CPM), {"remote": "/v2x/cam,/v2x/denm,/v2x/cpm"}, id="events-and-objects-beside-a-cam"),
        pytest.param((SDSM, DENM, BSM), {"remote": "/v2x/bsm,/v2x/sdsm,/v2x/denm"}, id="objects-beside-a-bsm"),
        pytest.param((CPM, SDSM), {"remote": "/v2x/cpm,/v2x/sdsm"}, id="objects-alone"),
        pytest.param((BSM,), {"remote": "/v2x/bsm"}, id="one-station-and-no-ego"),
        pytest.param(
            (ODE,),
            {
                "ego_position": "/v2x/ode_bsm",
                "ego_speed": "/v2x/ode_bsm",
                "ego_heading": "/v2x/ode_bsm",
                "remote": "/v2x/ode_bsm",
            },
            id="ode-holds-ego-and-remote",
        ),
        pytest.param((FIX, ODE), {"ego_position": "/gps/fix"}, id="a-gnss-comes-before-the-own-bsm"),
        pytest.param((ODOM,), {"ego_position": "/odom", "ego_speed": "/odom"}, id="odometry-alone"),
        pytest.param((FIX, ODOM), {"ego_position": "/gps/fix", "ego_speed": "/odom"}, id="a-gnss-before-odometry"),
        pytest.param((TRUTH,), {"truth": "/truth/pose"}, id="truth-is-no-ego-pose"),
        pytest.param(
            (GROUND_TRUTH,),
            {"truth": "/sim/ground_truth/odom"},
            id="ground-truth",
        ),
        pytest.param((IMAGE,), {"camera": "/camera/front"}, id="camera"),
        pytest.param((OWN_FIX,), {}, id="cwcli-s-own-viewer-channel"),
        pytest.param((EMPTY_FIX,), {}, id="empty-channel"),
    ],
)
def test_bind_finds(channels: tuple[Channel, ...], expected: dict[str, str]) -> None:
    found = bound(*channels)
    assert {role: found.get(role) for role in expected} == expected
    assert expected or not found


def test_bind_own_roles_go_by_name() -> None:
    state = Channel("/cwcli/ego/state", "cwcli.v1.VehicleState", "protobuf")
    remote = Channel("/cwcli/remote/state", "cwcli.v1.VehicleState", "protobuf")
    assert bound(state, remote) == {"ego_state": "/cwcli/ego/state", "remote_state": "/cwcli/remote/state"}


def test_bind_ego_station_makes_a_v2x_channel_the_ego() -> None:
    assert "ego_position" not in bound(BSM)
    assert bound(BSM, ego_station="2a3c600d")["ego_position"] == "/v2x/bsm"


def test_bind_missing_required_role_says_what_was_found_and_what_to_do() -> None:
    with pytest.raises(MissingSignalError) as raised:
        bind_roles([FIX, IMAGE], {}, required=[EGO_STATE.role], where="drive.mcap", command="predict")
    assert str(raised.value) == "drive.mcap: no channel holds the ego state (needed by `cwcli predict`)"
    assert raised.value.found == ("/gps/fix (sensor_msgs/msg/NavSatFix)", "/camera/front (foxglove.CompressedImage)")
    assert raised.value.hint.startswith("run `cwcli estimate ")
    assert raised.value.exit_code == 4


LANES = Channel("/cwcli/lanes", "cwcli.v1.Lanes", "protobuf")
OBSERVER = Channel("/cwcli/observer", "cwcli.v1.LateralState", "protobuf")


@pytest.mark.parametrize(
    ("channels", "role", "command", "hint"),
    [
        (
            [IMAGE, TWIST],
            EGO_STATE.role,
            "predict",
            "no channel holds a position for `cwcli estimate`; from the camera: `cwcli lanes`, `cwcli observe`, "
            "`cwcli predict-lane`",
        ),
        (
            [IMAGE],
            EGO_STATE.role,
            "predict",
            "no channel holds a position for `cwcli estimate`; from the camera: `cwcli lanes`, `cwcli observe` (it "
            "needs the car's speed too, which no channel holds), `cwcli predict-lane`",
        ),
        (
            [IMAGE, TWIST, LANES, OBSERVER],
            EGO_STATE.role,
            "warn",
            "no channel holds a position for `cwcli estimate`; from the camera: `cwcli predict-lane`, "
            "`cwcli warn-lane`",
        ),
        ([IMAGE, TWIST, LANES], EGO_PATH.role, "warn", None),
        ([TWIST], EGO_STATE.role, "predict", "run `cwcli estimate LOG -o annotated.mcap` first"),
        ([IMAGE, TWIST], EGO_STATE.role, "control", "run `cwcli estimate LOG -o annotated.mcap` first"),
        ([FIX, IMAGE], EGO_STATE.role, "warn", "run `cwcli estimate LOG -o annotated.mcap` first"),
    ],
)
def test_bind_without_a_position_points_to_the_camera(
    channels: list[Channel], role: str, command: str, hint: str | None
) -> None:
    with pytest.raises(MissingSignalError) as raised:
        bind_roles(channels, {}, required=[role], where="drive.mcap", command=command)
    assert raised.value.hint == (
        hint
        or "no channel holds a position for `cwcli estimate`; from the camera: `cwcli observe`, "
        "`cwcli predict-lane`, `cwcli warn-lane`"
    )


def test_bind_two_candidates_for_a_required_role_names_both_and_the_option() -> None:
    second = Channel("/novatel/fix", "foxglove.LocationFix", "protobuf")
    with pytest.raises(MissingSignalError) as raised:
        bind_roles([FIX, second], {}, required=[Role.EGO_POSITION], where="drive.mcap", command="estimate")
    message = str(raised.value)
    assert "/gps/fix (sensor_msgs/msg/NavSatFix)" in message
    assert "/novatel/fix (foxglove.LocationFix)" in message
    assert raised.value.hint == (
        "choose one with --topic ego_position=/gps/fix or --topic ego_position=/novatel/fix, "
        "or several with commas: --topic ego_position=/gps/fix,/novatel/fix"
    )


def test_bind_two_candidates_for_an_optional_role_leaves_it_with_a_note() -> None:
    bindings = bind_roles([FIX, TRUTH, TRUTH_IMU], {}, required=[Role.EGO_POSITION], optional=[Role.TRUTH])
    assert Role.TRUTH not in bindings
    assert len(bindings.notes) == 1
    for part in ("/truth/pose ", "/truth/pose_imu ", "--topic truth=/truth/pose_imu"):
        assert part in bindings.notes[0]


def test_bind_what_tells_of_others_is_no_rival_among_too_many() -> None:
    bindings = bind_roles([CAM, DENM, BSM], {}, required=(), optional=[Role.REMOTE])
    assert Role.REMOTE not in bindings
    assert [each.topic for each in bindings.undecided[Role.REMOTE]] == ["/v2x/cam", "/v2x/bsm"]
    assert "/v2x/denm" not in bindings.notes[0]


def test_bind_override_decides() -> None:
    bindings = bind_roles([FIX, TRUTH, TRUTH_IMU], {"truth": "/truth/pose_imu"}, required=(), optional=[Role.TRUTH])
    assert bindings.first_topic_of_role(Role.TRUTH) == "/truth/pose_imu"
    assert bindings.channels_of_role(Role.TRUTH)[0].is_override


def test_bind_override_may_cross_the_guess_from_the_topic() -> None:
    assert bound(TWIST, overrides={"ego_velocity": "/vehicle/twist"})["ego_velocity"] == "/vehicle/twist"
    assert bound(IMU, overrides={"ego_heading": "imu/data"})["ego_heading"] == "/imu/data"


def test_bind_override_lists_several_topics_where_a_car_can_have_several_sensors() -> None:
    assert bound(BSM, CAM, overrides={"remote": "/v2x/bsm,/v2x/cam"})["remote"] == "/v2x/bsm,/v2x/cam"
    bindings = bind_roles([FIX, ODOM], {"ego_position": "/gps/fix, /odom"}, required=[Role.EGO_POSITION])
    assert [each.topic for each in bindings.channels_of_role(Role.EGO_POSITION)] == ["/gps/fix", "/odom"]
    with pytest.raises(UsageError):
        bind_roles([TRUTH, TRUTH_IMU], {"truth": "/truth/pose,/truth/pose_imu"}, required=(), optional=[Role.TRUTH])


def test_poses_beside_an_odometry_and_poses_to_reach_are_not_taken_for_it() -> None:
    others = ("/initialpose", "/localization/pose_with_covariance", "/planning/goal_pose")
    poses = [Channel(topic, "geometry_msgs/msg/PoseWithCovarianceStamped", "cdr") for topic in others]
    odometry = Channel("/localization/kinematic_state", "nav_msgs/msg/Odometry", "cdr")
    for channels, topic in (([*poses, odometry], odometry.topic), (poses, others[1])):
        assert bind_roles(channels, {}, required=[Role.EGO_POSITION]).first_topic_of_role(Role.EGO_POSITION) == topic


def test_bind_mapping_names_the_fields_of_any_channel() -> None:
    status = Channel("/status", "my_msgs/msg/Status", "cdr")
    binding = bind_roles(
        [status], {"ego_speed": "/status:wheel.kmh*kmh@at"}, required=[Role.EGO_SPEED]
    ).channels_of_role("ego_speed")[0]
    assert {"wheel.kmh", "at", "at.sec", "at.nanosec"} <= set(binding.fields)
    with pytest.raises(UsageError, match="no topic /other"):
        bind_roles([status], {"ego_speed": "/other:v"}, required=())


@pytest.mark.parametrize(
    ("overrides", "parts"),
    [
        pytest.param(
            {"ego_positon": "/gps/fix"}, ("no role ego_positon", "did you mean ego_position?"), id="unknown-role"
        ),
        pytest.param({"ego_position": "/gsp/fix"}, ("no topic /gsp/fix", "/gps/fix"), id="unknown-topic"),
        pytest.param({"ego_position": "/imu/data"}, ("sensor_msgs/Imu can't hold", "/gps/fix"), id="wrong-schema"),
        pytest.param({"camera": "/imu/data"}, ("can't hold", "no channel of this log"), id="no-topic-can"),
    ],
)
def test_bind_override_that_does_not_fit_lists_what_would(overrides: dict[str, str], parts: tuple[str, str]) -> None:
    with pytest.raises(UsageError) as raised:
        bind_roles([FIX, IMU], overrides, required=[Role.EGO_POSITION])
    assert parts[0] in str(raised.value)
    assert parts[1] in raised.value.hint


def test_parse_overrides_reads_role_and_topic() -> None:
    assert parse_role_overrides(["truth=/truth/pose", "imu=/a"]) == {"truth": "/truth/pose", "imu": "/a"}


@pytest.mark.parametrize("options", [["truth"], ["truth="], ["imu=/a", "imu=/b"]])
def test_parse_overrides_refuses(options: list[str]) -> None:
    with pytest.raises(UsageError):
        parse_role_overrides(options)


def test_wanted_gathers_the_fields_of_all_roles_and_skips_cameras() -> None:
    bindings: Bindings = bind_roles([FIX, IMAGE, ODE], {}, required=(), optional=ALL_ROLE_NAMES)
    wanted = bindings.fields_to_load()
    assert set(wanted) == {"/gps/fix", "/v2x/ode_bsm"}
    assert {"latitude", "header.stamp.sec", "status.status"} <= wanted["/gps/fix"]
    assert {"metadata.bsmSource", "payload.data.coreData.secMark"} <= wanted["/v2x/ode_bsm"]


@pytest.mark.parametrize(
    "name", ["sensor_msgs/msg/NavSatFix", "sensor_msgs/NavSatFix", "sensor_msgs::msg::dds_::NavSatFix_"]
)
def test_normalise_knows_the_spellings_of_a_ros_schema(name: str) -> None:
    assert normalise_schema_name(name) == "sensor_msgs/NavSatFix"


def test_input_for_takes_the_java_name_of_an_ode_record() -> None:
    assert find_input_for_role(Role.REMOTE, "us.dot.its.jpo.ode.model.OdeBsmData") is not None
    assert find_input_for_role(Role.REMOTE, "somebody.else.Thing") is None


def test_every_entry_of_the_registry_names_its_fields_or_streams() -> None:
    for name, entries in INPUTS_BY_SCHEMA_NAME.items():
        assert name == normalise_schema_name(name)
        assert len({entry.role for entry in entries}) == len(entries)
        for entry in entries:
            assert entry.build is None or all(entry.fields.values())


def test_missing_role_says_that_its_channel_has_no_messages() -> None:
    with pytest.raises(MissingSignalError, match="/gps/fix has no messages") as error:
        bind_roles((EMPTY_FIX, IMU), {}, required=(Role.EGO_POSITION,))
    assert "/gps/fix (sensor_msgs/msg/NavSatFix, no messages)" in error.value.found
    assert "can be named" not in (error.value.hint or "")
