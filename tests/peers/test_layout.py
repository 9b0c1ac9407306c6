"""The viewer layout: every channel is shown, with fields that it has, by panels and settings that the viewer knows.

The oracle of panels and settings is Foxglove's own model of them, `foxglove.layouts` of its SDK.
"""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import foxglove.layouts as fl
import pytest

from cwcli.channels.published import schema_name_by_published_topic
from cwcli.logs.encoders.schemas import find_message_schema
from cwcli.logs.read.reader import Log
from cwcli.report.viewer_layout import TAB_TITLES, CameraTopics, LogTopics, build_viewer_layout, find_log_topics
from cwcli.report.viewer_panels import PANEL_TYPES, PanelCollection, message_path, quote_topic

ROOT = Path(__file__).parents[2]
CONFIGS: dict[str, type[Any]] = {
    "3D": fl.ThreeDeeConfig,
    "Image": fl.ImageConfig,
    "map": fl.MapConfig,
    "Plot": fl.PlotConfig,
    "RawMessages": fl.RawMessagesConfig,
    "RosOut": fl.LogConfig,
    "StateTransitions": fl.StateTransitionsConfig,
}
TITLE = "foxglovePanelTitle"
GENERAL = build_viewer_layout()
BOUND = build_viewer_layout(
    LogTopics(
        fixes=("/gps/fix",),
        cameras=(CameraTopics("/front/image", "/front/camera_info"), CameraTopics("/rear/image", None)),
        scene_topics=("/detections",),
        truth=("/truth/ego",),
        speed=("/vehicle/velocity.longitudinal_velocity",),
        yaw_rate=("/imu/data.angular_velocity.z",),
    )
)
DOCUMENTS = pytest.mark.parametrize("document", [GENERAL, BOUND], ids=["of any log", "of a log"])


def panels(document: dict[str, Any], *kinds: str) -> Iterator[dict[str, Any]]:
    for name, settings in document["configById"].items():
        if name.partition("!")[0] in kinds:
            yield settings


def message_paths(document: dict[str, Any]) -> Iterator[str]:
    for settings in panels(document, "Plot", "StateTransitions"):
        yield from (series["value"] for series in settings["paths"])
        if "xAxisPath" in settings:
            yield settings["xAxisPath"]["value"]


def shown_topics(document: dict[str, Any]) -> set[str]:
    shown = {value.partition(".")[0] for value in message_paths(document)}
    for settings in panels(document, "3D"):
        shown.update(topic for topic, how in settings["topics"].items() if how["visible"])
    for settings in panels(document, "map"):
        shown.update(settings["topicColors"])
    for settings in panels(document, "Image"):
        mode = settings["imageMode"]
        shown.update(topic for topic, how in mode["annotations"].items() if how["visible"])
        shown.update({mode[key] for key in ("imageTopic", "calibrationTopic") if key in mode})
    shown.update(settings["topicPath"] for settings in panels(document, "RawMessages"))
    shown.update(settings["topicToRender"] for settings in panels(document, "RosOut"))
    return shown


@DOCUMENTS
def test_every_published_channel_is_shown(document: dict[str, Any]) -> None:
    assert set(schema_name_by_published_topic()) - shown_topics(document) == set()


def test_a_logs_own_channels_are_shown() -> None:
    own = {"/gps/fix", "/front/image", "/front/camera_info", "/rear/image", "/detections", "/truth/ego", "/imu/data"}
    assert own - shown_topics(BOUND) == set()
    assert shown_topics(GENERAL) - set(schema_name_by_published_topic()) == set()
    assert [settings["imageMode"].get("imageTopic") for settings in panels(BOUND, "Image")] == [
        "/front/image",
        "/front/image",
        "/rear/image",
    ]


@DOCUMENTS
def test_every_field_is_in_the_schema_of_its_channel(document: dict[str, Any]) -> None:
    n = 0
    for value in message_paths(document):
        topic, _, names = value.partition(".")
        if topic not in schema_name_by_published_topic():
            continue
        message: Any = find_message_schema(schema_name_by_published_topic()[topic]).descriptor
        for name in names.split("."):
            plain = name.removesuffix("[:]")
            assert plain in message.fields_by_name, value
            field = message.fields_by_name[plain]
            is_array = field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED
            assert is_array == name.endswith("[:]"), value
            message = field.message_type
        assert message is None, f"{value} is not a number"
        n += 1
    assert n >= 40


def check_settings(model: type[Any], settings: dict[str, Any], where: str) -> None:
    """Every key is a field of Foxglove's model of it, every value of its type."""
    hints = typing.get_type_hints(model, vars(fl))
    names = {re.sub(r"_(\w)", lambda found: found[1].upper(), name): name for name in hints}
    for key, value in settings.items():
        if key == "layerId":
            continue
        assert key in names, f"{where}.{key}"
        assert fits(hints[names[key]], value, f"{where}.{key}"), f"{where}.{key} = {value!r}"


def fits(hint: Any, value: Any, where: str) -> bool:  # noqa: PLR0911 - one return a kind of type
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        return any(_tries(each, value, where) for each in arguments)
    if origin is Literal:
        return value in arguments
    if origin is list:
        return isinstance(value, list) and all(fits(arguments[0], each, where) for each in value)
    if origin is dict:
        return isinstance(value, dict) and all(fits(arguments[1], each, where) for each in value.values())
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if isinstance(hint, type) and issubclass(hint, fl._BaseModel):
        if not isinstance(value, dict):
            return False
        check_settings(hint, value, where)
        return True
    return isinstance(value, hint)


def _tries(hint: Any, value: Any, where: str) -> bool:
    try:
        return fits(hint, value, where)
    except AssertionError:
        return False


@DOCUMENTS
def test_panels_and_settings_are_those_of_the_viewer(document: dict[str, Any]) -> None:
    kinds = {name.partition("!")[0] for name in document["configById"]}
    assert kinds == set(PANEL_TYPES) == {*CONFIGS, "Tab", "SourceInfo"}
    for name, settings in document["configById"].items():
        kind = name.partition("!")[0]
        if kind in CONFIGS:
            check_settings(CONFIGS[kind], {key: value for key, value in settings.items() if key != TITLE}, name)


def test_the_check_of_settings_finds_wrong_ones() -> None:
    for settings in ({"nothing": 1}, {"xAxisVal": "time"}, {"paths": [{"value": 3}]}, {"showLegend": "yes"}):
        with pytest.raises(AssertionError):
            check_settings(fl.PlotConfig, settings, "Plot")


def leaves(mosaic: Any) -> Iterator[str]:
    if isinstance(mosaic, str):
        yield mosaic
        return
    assert set(mosaic) == {"direction", "first", "second", "splitPercentage"}
    assert mosaic["direction"] in ("row", "column")
    assert 0.0 < mosaic["splitPercentage"] < 100.0
    yield from leaves(mosaic["first"])
    yield from leaves(mosaic["second"])


@DOCUMENTS
def test_every_panel_stands_in_one_place(document: dict[str, Any]) -> None:
    assert set(document) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    [root] = leaves(document["layout"])
    tabs = document["configById"][root]["tabs"]
    placed = [root, *(name for tab in tabs for name in leaves(tab["layout"]))]
    assert tuple(tab["title"] for tab in tabs) == TAB_TITLES
    assert sorted(placed) == sorted(document["configById"])


def test_topics_of_a_real_log() -> None:
    with Log.open(ROOT / "sample_logs" / "intersection.mcap") as log:
        found = find_log_topics(log)
    assert found == LogTopics(
        fixes=("/gps/fix",),
        truth=("/truth/ego", "/simulation/vehicles"),
        speed=("/vehicle/velocity.longitudinal_velocity",),
        yaw_rate=("/imu/data.angular_velocity.z",),
    )


def test_cameras_find_their_calibration_and_own_channels_are_not_repeated() -> None:
    def channel(topic: str, schema: str) -> SimpleNamespace:
        return SimpleNamespace(topic=topic, schema_name=schema, message_encoding="protobuf", message_count=1)

    log: Any = SimpleNamespace(
        channels=[
            channel("/front/image", "foxglove.CompressedImage"),
            channel("/front/info", "foxglove.CameraCalibration"),
            channel("/rear/image", "foxglove.CompressedImage"),
            channel("/rear/info", "foxglove.CameraCalibration"),
            channel("/side/image", "foxglove.CompressedImage"),
            channel("/cwcli/ego/fix", "foxglove.LocationFix"),
            channel("/cwcli/camera", "foxglove.CompressedImage"),
        ]
    )
    found = find_log_topics(log)
    assert found.cameras == (
        CameraTopics("/front/image", "/front/info"),
        CameraTopics("/rear/image", "/rear/info"),
        CameraTopics("/side/image", None),
        CameraTopics("/cwcli/camera", None),
    )
    assert found.fixes == ()


def test_topics_with_characters_of_the_path_syntax_are_quoted() -> None:
    assert quote_topic("/cwcli/ego/state") == "/cwcli/ego/state"
    assert message_path('/a b."c"{x==1}', "y") == '"/a b.\\"c\\"{x==1}".y'


def test_a_panel_name_is_taken_once_and_its_kind_is_known() -> None:
    panels = PanelCollection()
    panels.add_raw_messages("one", "/a")
    for kind, name in (("RawMessages", "one"), ("Gauge", "two")):
        with pytest.raises(ValueError, match="can't add"):
            panels.add_panel(kind, name, "")
