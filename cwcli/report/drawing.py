"""What all figures share: colours that colour-blind readers can tell apart, safe text, short numbers.

The figures are Plotly's JSON, made by hand: two dictionaries each. Colours: Okabe and Ito's palette. What differs in
colour differs in dash or symbol too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cwcli.signals.columns import FloatArray
from cwcli.text import escape_control_characters

Figure = dict[str, Any]
Trace = dict[str, Any]

EGO_COLOUR = "#0072B2"
"""Colour of the ego vehicle. From Okabe and Ito's palette."""
WARNING_COLOUR = "#D55E00"
"""Colour of warnings and gated measurements. From Okabe and Ito's palette."""
OTHER_SYSTEM_COLOUR = "#5B3A8C"
"""Colour of another system's warnings. Chosen by hand; not fitted."""
MEASURED_COLOUR = "#767676"
"""Colour of raw measurements, a grey. Chosen by hand; not fitted."""
TRUTH_COLOUR = "#000000"
"""Colour of the truth, black. Chosen by hand; not fitted."""
OTHER_VEHICLE_COLOURS = ("#CC79A7", "#009E73", "#8A6D00", "#56B4E9", "#5B3A8C", "#A6611A")
"""Colours of the other vehicles, in order; the first two and the fourth are Okabe and Ito's.
Chosen by hand; not fitted."""
AXIS_TITLE_STYLE = {"font": {"size": 13}}
"""Font size of axis titles in pixels, as Plotly's settings. Chosen by hand; not fitted."""
MAX_NAME_CHARACTERS = 40
"""The greatest length of a name in a figure, in characters; longer ones are cut. Chosen by hand; not fitted."""


def rgba_colour(colour: str, alpha: float) -> str:
    """Convert a colour such as `#0072B2` to `rgba(0,114,178,0.2)`."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{alpha:g})"


def escape_figure_text(text: str) -> str:
    """Escape text from a log for a figure: Plotly takes `<` for the start of a tag and `%{` for a variable."""
    shown = escape_control_characters(text)
    shown = shown if len(shown) <= MAX_NAME_CHARACTERS else shown[: MAX_NAME_CHARACTERS - 1] + "…"
    return shown.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("%{", "%&#8203;{")


def rounded_json_numbers(values: FloatArray, decimals: int) -> list[float | None]:
    """Round numbers for JSON: whole ones without a fraction, None where not finite."""
    listed = np.round(np.asarray(values, np.float64), decimals).tolist()
    return [None if not np.isfinite(value) else int(value) if value == int(value) else value for value in listed]


def axis_settings(title: str, **more: Any) -> dict[str, Any]:
    """Return Plotly's settings of an axis with its title, which includes the unit."""
    return {"title": {"text": title, **AXIS_TITLE_STYLE}, **more}


def line_trace(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, **more: Any) -> Trace:
    """Return a line trace. `name` is shown as it is: pass text from a log through `words`."""
    style = {"color": colour, "width": more.pop("width", 2), "dash": more.pop("dash", "solid")}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "name": name, "line": style, **more}


def marker_trace(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, **more: Any) -> Trace:
    """Return a trace of markers; `name` is shown as it is."""
    style = {"color": colour, "size": more.pop("size", 4), "symbol": more.pop("symbol", "circle")}
    style |= {key: more.pop(key) for key in ("opacity", "line") if key in more}
    return {"type": "scatter", "mode": "markers", "x": x, "y": y, "name": name, "marker": style, **more}


def polygon_trace(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, **more: Any) -> Trace:
    """Return the trace of a filled outline without an edge."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y,
        "name": name,
        "fill": "toself",
        "fillcolor": rgba_colour(colour, more.pop("alpha", 0.2)),
        "line": {"width": 0},
        "hoverinfo": "skip",
        **more,
    }


def vertical_line_with_label(
    x: float, text: str, colour: str, *, dash: str = "dash"
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a vertical line over the whole height at x = `at`, and its label at the top."""
    shape = {
        "type": "line",
        "xref": "x",
        "yref": "paper",
        "x0": x,
        "x1": x,
        "y0": 0,
        "y1": 1,
        "line": {"color": colour, "width": 1.5, "dash": dash},
    }
    label = {
        "xref": "x",
        "yref": "paper",
        "x": x,
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


def equalise_axis_scales(layout: dict[str, Any]) -> dict[str, Any]:
    """Set one metre to be as long on the y axis as on the x axis, and return the layout."""
    layout["yaxis"] = {**layout["yaxis"], "scaleanchor": "x", "scaleratio": 1}
    return layout
