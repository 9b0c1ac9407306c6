"""The lane methods: one file each, and one line here. Other packages add theirs in the group `cwcli.lane_methods`."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from cwcli.registry import Plugin, Registry, guarded, plugin_entry
from cwcli.vision.method import LaneSearch, Method, check_fit, check_size


def _accept(entry: object, plugin: Plugin) -> Method:
    """A plug-in's method, with its searches guarded too."""
    method = plugin_entry(Method, {"search_size": check_size})(entry, plugin)

    def make(seed: int) -> LaneSearch:
        search = method.make(seed)
        if not callable(getattr(search, "step", None)):
            raise plugin.error(f"makes a {type(search).__name__}, which has no step")
        return SimpleNamespace(step=guarded(search.step, "step", check_fit, plugin))

    return replace(method, make=make)


METHODS: Registry[Method] = Registry(
    "lane method",
    "cwcli.lane_methods",
    {
        "cwcli": "cwcli.vision.lane_tracker:METHOD",
        "zhang2011": "cwcli.vision.zhang2011:METHOD",
    },
    _accept,
)
DEFAULT_METHOD = "cwcli"
