"""The lane methods: one file each, and one line here. Other packages add theirs in the group `cwcli.lane_methods`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from cwcli.errors import UsageError
from cwcli.registry import Plugin, Registry, accept_dataclass_of, guard_plugin_function
from cwcli.vision.method import LaneSearch, Method, check_lane_fit, check_search_size


def _check_plugin_method(entry: object, plugin: Plugin) -> Method:
    """Check a plug-in's method, and guard its searches too."""
    method = accept_dataclass_of(Method, {"search_size": check_search_size})(entry, plugin)

    def make_guarded_search(seed: int) -> LaneSearch:
        search = method.make(seed)
        if not callable(getattr(search, "step", None)):
            raise plugin.plugin_error(f"makes a {type(search).__name__}, which has no step")
        return SimpleNamespace(step=guard_plugin_function(search.step, "step", check_lane_fit, plugin))

    return replace(method, make=make_guarded_search, carry=None)  # a guarded search has nothing but its step


METHODS: Registry[Method] = Registry(
    "lane method",
    "cwcli.lane_methods",
    {
        "cwcli": "cwcli.vision.lane_tracker:METHOD",
        "zhang2011": "cwcli.vision.zhang2011:METHOD",
        "onnx": "cwcli.vision.onnx_lanes:METHOD",
    },
    _check_plugin_method,
)
"""The lane methods by name: the built-in ones, and those that other packages register."""
DEFAULT_METHOD = "cwcli"
"""Name of the lane method that is used where none is named."""


def methods_without_model() -> tuple[str, ...]:
    """Names of the methods that take no model (`Method.with_model`), so that each can be used as it is."""
    return tuple(name for name, method in METHODS.items() if method.with_model is None)


def check_method_and_model(name: str, model: str | None) -> None:
    """Check that a method is there, and that a model is named if and only if it takes one (`Method.with_model`).

    Raises:
        UsageError: The method is unknown, its model is missing, or it takes none.
    """
    METHODS.require(name)
    takes_model = METHODS[name].with_model is not None
    if takes_model and model is None:
        raise UsageError(f"--method {name} needs a net", hint="--model net.onnx, with net.toml in the same folder")
    if model is not None and not takes_model:
        raise UsageError(f"--method {name} takes no --model", hint="--method onnx")


def load_method(name: str, model: str | None) -> Method:
    """The method of a name, with its model loaded if it takes one.

    Raises:
        InputError, UsageError: The model can't be used.
    """
    method = METHODS[name]
    return method if method.with_model is None or model is None else method.with_model(Path(model))
