"""Panels of a viewer layout in the JSON that Foxglove exports and imports; Lichtblick reads the same.

`configById` holds the settings of each panel under `<type>!<name>`, `layout` says how the panels divide the window: a
panel's name, or two parts beside or above one another. A panel of type `Tab` holds such layouts in turn.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Any

from cwcli.lazy_dataclass import dataclass

PANEL_TYPES = ("3D", "Image", "map", "Plot", "RawMessages", "RosOut", "SourceInfo", "StateTransitions", "Tab")
"""Types of panels that are used here, as the viewer names them; `RosOut` is the Log panel."""

Mosaic = str | dict[str, Any]
Settings = dict[str, Any]
MessagePathAndLabel = tuple[str, str]
"""A message path and its label."""

_UNQUOTED_TOPIC_PATTERN = re.compile(r"[A-Za-z0-9_/-]+")
"""Topics that message paths name without quotes."""
LOG_LEVEL_INFO = 2
"""Number of the level INFO in the viewer's log panel."""


@dataclass
class PanelCollection:
    """Collects the settings of panels. Each method adds one and returns its name for the mosaic."""

    settings_by_panel: dict[str, Settings] = field(default_factory=dict)

    def add_panel(self, kind: str, name: str, title: str, **settings: Any) -> str:
        """Add a panel of a kind.

        Raises:
            ValueError: The name is taken, or the viewer has no such kind.
        """
        panel = f"{kind}!{name}"
        if kind not in PANEL_TYPES or panel in self.settings_by_panel:
            raise ValueError(f"can't add the panel {panel}")
        self.settings_by_panel[panel] = {"foxglovePanelTitle": title, **settings}
        return panel

    def add_plot(self, name: str, title: str, series: Sequence[MessagePathAndLabel], *, points: bool = False) -> str:
        """Add a plot of values over time, as lines or as points."""
        return self.add_panel(
            "Plot",
            name,
            title,
            paths=_plot_path_settings(series, points=points),
            xAxisVal="timestamp",
            **_PLOT_SETTINGS,
        )

    def add_array_plot(self, name: str, title: str, x_path: str, y_path: MessagePathAndLabel) -> str:
        """Add a plot of the latest message's array y over its array x, on equal scales."""
        return self.add_panel(
            "Plot",
            name,
            title,
            paths=_plot_path_settings([y_path]),
            xAxisVal="currentCustom",
            xAxisPath={"value": x_path, "enabled": True},
            axisScalesMode="lockedScales",
            **_PLOT_SETTINGS | {"isSynced": False},
        )

    def add_state_transitions(self, name: str, title: str, series: Sequence[MessagePathAndLabel]) -> str:
        """Add a panel that shows when values changed."""
        return self.add_panel("StateTransitions", name, title, paths=_plot_path_settings(series), isSynced=True)

    def add_raw_messages(self, name: str, topic: str) -> str:
        """Add a panel of a topic's messages as they are."""
        return self.add_panel("RawMessages", name, topic, topicPath=quote_topic(topic), diffEnabled=False)

    def add_log_line_panel(self, name: str, title: str, topic: str) -> str:
        """Add a panel of log lines from level INFO on."""
        return self.add_panel("RosOut", name, title, topicToRender=topic, minLogLevel=LOG_LEVEL_INFO, searchTerms=[])

    def add_tabs(self, name: str, tabs: Mapping[str, Mosaic]) -> str:
        """Add a panel of layouts behind tabs, the first one on top."""
        entries = [{"title": title, "layout": layout} for title, layout in tabs.items()]
        return self.add_panel("Tab", name, "cwcli", activeTabIdx=0, tabs=entries)

    def layout_document(self, mosaic: Mosaic) -> Settings:
        """Return the whole layout document."""
        return {
            "configById": self.settings_by_panel,
            "globalVariables": {},
            "userNodes": {},
            "playbackConfig": {"speed": 1},
            "layout": mosaic,
        }


_PLOT_SETTINGS: Settings = {
    "isSynced": True,
    "showXAxisLabels": True,
    "showYAxisLabels": True,
    "showLegend": True,
    "legendDisplay": "floating",
    "showPlotValuesInLegend": True,
    "sidebarDimension": 240,
}
"""Settings that all plot panels share."""


def _plot_path_settings(series: Sequence[MessagePathAndLabel], *, points: bool = False) -> list[Settings]:
    """Return the plot settings of message paths."""
    more = {"showLine": False} if points else {}
    return [
        {"value": path, "label": label, "enabled": True, "timestampMethod": "receiveTime", **more}
        for path, label in series
    ]


def place_in_row(*parts: Mosaic) -> Mosaic:
    """Place parts side by side, equally wide."""
    return _split_evenly("row", parts)


def place_in_column(*parts: Mosaic) -> Mosaic:
    """Stack parts, equally high."""
    return _split_evenly("column", parts)


def split_in_two(direction: str, first: Mosaic, second: Mosaic, percent: float) -> Mosaic:
    """Split the space in two; the first part takes `percent` of it."""
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percent}


def _split_evenly(direction: str, parts: Sequence[Mosaic]) -> Mosaic:
    """Split the space evenly in a direction."""
    first, *rest = parts
    return split_in_two(direction, first, _split_evenly(direction, rest), 100.0 / len(parts)) if rest else first


def message_path(topic: str, field_path: str) -> str:
    """Return the message path of a topic's field; the topic is quoted if it needs to be."""
    return f"{quote_topic(topic)}.{field_path}"


def quote_topic(topic: str) -> str:
    """Quote a topic as message paths name it, if it needs to be."""
    return topic if _UNQUOTED_TOPIC_PATTERN.fullmatch(topic) else json.dumps(topic, ensure_ascii=False)
