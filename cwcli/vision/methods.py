"""The lane methods: one file each, and one line here. Other packages add theirs in the group `cwcli.lane_methods`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

from cwcli.errors import PluginError
from cwcli.registry import Registry, guarded, plugin_entry
from cwcli.vision.method import LaneSearch, Method, check_fit, check_size


def _accept(entry: object, error: Callable[[str], PluginError]) -> Method:
    """A plug-in's method, with its searches guarded too."""
    method = plugin_entry(Method, {"search_size": check_size})(entry, error)

    def make(seed: int) -> LaneSearch:
        search = method.make(seed)
        if not callable(getattr(search, "step", None)):
            raise error(f"makes a {type(search).__name__}, which has no step")
        return SimpleNamespace(step=guarded(search.step, "step", check_fit, error))

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
