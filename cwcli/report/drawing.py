"""What all figures share: colours that colour-blind readers can tell apart, safe text, short numbers.

The figures are Plotly's JSON, made by hand: two dictionaries each. Colours: Okabe and Ito's palette. What differs in
colour differs in dash or symbol too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.text import printable

Figure = dict[str, Any]
Trace = dict[str, Any]

EGO = "#0072B2"
ALERT = "#D55E00"
SYSTEM = "#5B3A8C"
"""Another system's warnings."""
RAW = "#767676"
TRUTH = "#000000"
OTHERS = ("#CC79A7", "#009E73", "#8A6D00", "#56B4E9", "#5B3A8C", "#A6611A")
TITLE = {"font": {"size": 13}}
MAX_NAME = 40


def rgba(colour: str, alpha: float) -> str:
    """`#0072B2` as `rgba(0,114,178,0.2)`."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{alpha:g})"


def words(text: str) -> str:
    """Text from a log for a figure. Plotly takes `<` for the start of a tag and `%{` for a variable."""
    shown = printable(text)
    shown = shown if len(shown) <= MAX_NAME else shown[: MAX_NAME - 1] + "…"
    return shown.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("%{", "%&#8203;{")


def rounded(values: FloatArray, decimals: int) -> list[float | None]:
    """Numbers for JSON: rounded, whole ones without a fraction, None where not finite."""
    listed = np.round(np.asarray(values, np.float64), decimals).tolist()
    return [None if not np.isfinite(value) else int(value) if value == int(value) else value for value in listed]


def axis(title: str, **more: Any) -> dict[str, Any]:
    """An axis with its title, unit included."""
    return {"title": {"text": title, **TITLE}, **more}


def line(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, **more: Any) -> Trace:
    """A line. `name` is shown as it is: pass text from a log through `words`."""
    style = {"color": colour, "width": more.pop("width", 2), "dash": more.pop("dash", "solid")}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": style, **more}


def dots(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, **more: Any) -> Trace:
    """Markers; as `line`."""
    style = {"color": colour, "size": more.pop("size", 4), "symbol": more.pop("symbol", "circle")}
    style |= {key: more.pop(key) for key in ("opacity", "line") if key in more}
    return {"type": "scatter", "mode": "markers", "x": x, "y": y, "name": name, "marker": style, **more}


def polygon(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, **more: Any) -> Trace:
    """A filled outline without an edge."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "fill": "toself",
        "fillcolor": rgba(colour, more.pop("alpha", 0.2)),
        "line": {"width": 0},
        "hoverinfo": "skip",
        **more,
    }


def upright(at: float, text: str, colour: str, *, dash: str = "dash") -> tuple[dict[str, Any], dict[str, Any]]:
    """A vertical line over the whole height, and its label beside it, at the top."""
    shape = {
        "type": "line",
        "xref": "x",
        "yref": "paper",
        "x0": at,
        "x1": at,
        "y0": 0,
        "y1": 1,
        "line": {"color": colour, "width": 1.5, "dash": dash},
    }
    label = {
        "xref": "x",
        "yref": "paper",
        "x": at,
        "y": 1,
        "xanchor": "left",
        "yanchor": "top",
        "xshift": 2,
        "text": text,
        "showarrow": False,
        "bgcolor": "rgba(255,255,255,0.75)",
        "font": {"color": colour, "size": 12},
    }
    return shape, label


def equal_axes(layout: dict[str, Any]) -> dict[str, Any]:
    """One metre is as long on the one axis as on the other."""
    layout["yaxis"] = {**layout["yaxis"], "scaleanchor": "x", "scaleratio": 1}
    return layout
