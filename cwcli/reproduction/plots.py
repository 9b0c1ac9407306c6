"""Writes the redrawn figures as files."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cwcli.errors import UsageError, install_hint
from cwcli.output import PLOT_FILE_FORMATS, AtomicGroup, write_file
from cwcli.reproduction.findings import Curve, Plot


def check_plot_format(file_format: str) -> None:
    """Check that a format of plots exists.

    Raises:
        UsageError: As it says.
    """
    if file_format not in PLOT_FILE_FORMATS:
        raise UsageError(f"there is no plot format '{file_format}'", hint=f"one of: {', '.join(PLOT_FILE_FORMATS)}")


def require_matplotlib() -> None:
    """Check that matplotlib is installed.

    Raises:
        UsageError: matplotlib is not installed.
    """
    from importlib.util import find_spec

    if find_spec("matplotlib") is None:
        raise UsageError("plots need matplotlib", hint=install_hint("plots"))


def write_plots(
    plots: Sequence[Plot], folder: str, together: AtomicGroup, *, paper: str, file_format: str, force: bool = False
) -> list[str]:
    """Draw each plot into `<folder>/<figure>.<format>`; the folder must exist. `paper` stands in the titles.
    The files appear with the others of `together`.

    Returns:
        The files' names.

    Raises:
        UsageError: matplotlib is not installed, or an unknown format.
        OutputError: A file can't be written.
    """
    check_plot_format(file_format)
    require_matplotlib()
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "cwcli"  # the same input gives the same bytes
    return [_draw_and_write_plot(plot, paper, Path(folder), together, file_format, force) for plot in plots]


CURVE_STYLES: dict[str, dict[str, Any]] = {
    "left": {"color": "tab:orange", "linewidth": 1.6},
    "right": {"color": "tab:cyan", "linewidth": 1.6},
    "true": {"color": "tab:blue", "linewidth": 3.0, "zorder": 1.9},
    "detected": {"color": "yellowgreen", "zorder": 1.8},
    "estimated": {"color": "tab:red"},
    "left boundary": {"color": "0.4", "linewidth": 1.6},
    "right boundary": {"color": "0.65", "linewidth": 1.6},
    "zhang2011": {"color": "tab:blue"},
    "cwcli": {"color": "tab:red"},
    "camera": {"color": "tab:red", "linestyle": "--"},
    "camera and gyroscope": {"color": "tab:green", "linestyle": "-."},
    "host": {"color": "tab:blue"},
    "path of host": {"color": "tab:blue"},
    "lead": {"color": "tab:red"},
    "path of lead": {"color": "tab:red", "linestyle": "--"},
    "other": {"color": "tab:red"},
    "path of other": {"color": "tab:red", "linestyle": "--"},
    "f(v)": {"color": "tab:blue"},
    "printed: 1 + 0.000843 v^2": {"color": "black"},
    "four looks of the lidar": {"color": "tab:blue"},
    "four looks of the radar": {"color": "tab:orange"},
    "all eight": {"color": "tab:green"},
    "lidar, at most as printed": {"color": "tab:blue", "linestyle": ":"},
    "radar, at most as printed": {"color": "tab:orange", "linestyle": ":"},
    "printed bound of v_y, 10 %": {"color": "black", "linestyle": ":"},
    "circle of 40 m, printed": {"color": "tab:orange", "linestyle": ":"},
    "path": {"color": "yellow", "linewidth": 1.8},
    "actual": {"color": "black", "linewidth": 3.0, "zorder": 1.9},
    "measured": {"color": "0.75", "linewidth": 0.7},
    "our smoother": {"color": "tab:purple"},
    "our filter": {"color": "tab:red"},
    "the paper's filter": {"color": "tab:green", "linestyle": "--"},
    "constant speed": {"color": "tab:blue"},
    "constant acceleration": {"color": "tab:orange"},
    "constant jerk": {"color": "tab:green"},
    "our default": {"color": "tab:red", "linestyle": "--"},
    "printed sigma, +-0.15 m": {"color": "black", "linestyle": ":"},
    "printed sigma, +-0.1 m/s": {"color": "black", "linestyle": ":"},
    "car, yaw rate": {"color": "black"},
    "car, v_y": {"color": "0.5"},
    "zhang2011, yaw rate": {"color": "tab:blue"},
    "zhang2011, v_y": {"color": "tab:cyan"},
    "cwcli, yaw rate": {"color": "tab:red", "linestyle": "--"},
    "cwcli, v_y": {"color": "tab:orange", "linestyle": "--"},
}
"""Label of a curve -> its style in every figure; ours is dashed where it may cover the paper's, and what is true lies
broad under what is estimated. True is blue, detected green and estimated red, as in figures 7 and 8 of xiang2019."""
INSET_LEFT_BOTTOM_WIDTH_HEIGHT_SHARES = (0.5, 0.45, 0.48, 0.5)
"""Left, bottom, width and height of a detail, as shares of the plot: the upper right, where distances under control
leave room. Chosen by hand."""
VERTICAL_LINE_COLOURS_OF_OURS_AND_PAPER = ("black", "tab:purple")
"""Colours of the vertical lines: ours, the paper's."""
MAX_TITLE_CHARACTERS = 90
"""Characters of a title's line that fit above the plot. Chosen by hand."""
MIN_CHARACTERS_OF_LONG_LEGEND_LABEL = 15
"""Labels from this length on, in characters, leave room for three columns in the legend instead of five.
Chosen by hand; not fitted."""
MIN_MAP_HEIGHT_SHARE = 0.15
"""The least height of a map, as a share of its width. Chosen by hand; not fitted."""
N_PALETTE_COLOURS = 200
"""Number of colours of a PNG: half the bytes of true colour, without a visible difference.
Chosen by hand; not fitted."""


def _draw_and_write_plot(
    plot: Plot, paper: str, folder: Path, together: AtomicGroup, file_format: str, force: bool
) -> str:
    """Draw a plot and write it as a file."""
    import io

    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    if plot.image is not None:
        height, width = plot.image.shape
        axes.imshow(plot.image, cmap="gray", vmin=0, vmax=255, extent=(0.0, width, 0.0, height), aspect="equal")
    if plot.is_map:
        axes.set_aspect("equal")
    for curve in plot.curves:
        _draw_curve(axes, curve, plot.level)
    for (label, x), colour in zip(plot.marks.items(), VERTICAL_LINE_COLOURS_OF_OURS_AND_PAPER, strict=False):
        axes.axvline(x, color=colour, linestyle=":", linewidth=1.2, label=label)
    if plot.level is not None:
        label, y = plot.level
        axes.axhline(y, color="black", linestyle="-.", linewidth=0.8, label=label)
    if plot.is_map:  # two cars behind one another leave a line without height
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        half = 0.5 * max(high - low, MIN_MAP_HEIGHT_SHARE * (right - left))
        axes.set_ylim(0.5 * (low + high) - half, 0.5 * (low + high) + half)
    title = textwrap.fill(f"{paper} {plot.figure}. {plot.title}", MAX_TITLE_CHARACTERS)
    axes.set_title(title, fontsize="medium")
    axes.set_xlabel(plot.x_label)
    axes.set_ylabel(plot.y_label)
    if plot.x_range is not None:
        axes.set_xlim(plot.x_range)
    if plot.y_range is not None:
        axes.set_ylim(plot.y_range)
    if plot.image is None:
        axes.grid(alpha=0.3)
    if plot.detail is not None:
        _draw_detail(axes, plot.detail)
    labels = axes.get_legend_handles_labels()[1]
    columns = 5 if max(map(len, labels), default=0) < MIN_CHARACTERS_OF_LONG_LEGEND_LABEL else 3
    figure.legend(loc="outside lower center", ncols=max(min(len(labels), columns), 1), fontsize="small")
    sink = io.BytesIO()
    metadata = {"Date": None} if file_format == "svg" else {"Software": "cwcli"}
    figure.savefig(sink, format=file_format, dpi=110, metadata=metadata)
    data = _reduce_png_palette(sink.getvalue()) if file_format == "png" else sink.getvalue()
    path = folder / f"{plot.figure.replace(' ', '-')}.{file_format}"
    write_file(path, memoryview(data), force=force, together=together)
    return str(path)


def _draw_curve(axes: Any, curve: Curve, level: tuple[str, float] | None) -> None:
    """Draw a curve with its dot, and an open diamond on the level where the paper has the dot."""
    import numpy as np

    style: dict[str, Any] = {"linewidth": 1.2, **CURVE_STYLES.get(curve.label, {})}
    if curve.is_points:
        style |= {"linestyle": "", "marker": "o", "markersize": 3.0}
    (line,) = axes.plot(curve.x, curve.y, label=curve.label, **style)
    if np.isfinite(curve.dot_x):
        axes.plot(curve.dot_x, np.interp(curve.dot_x, curve.x, curve.y), "o", color=line.get_color(), markersize=5)
    if np.isfinite(curve.printed_x) and level is not None:
        axes.plot(curve.printed_x, level[1], "D", color=line.get_color(), fillstyle="none", markersize=7)


def _draw_detail(axes: Any, detail: tuple[tuple[float, float], tuple[float, float]]) -> None:
    """Draw the lines of the axes again in a part of them, enlarged."""
    inset = axes.inset_axes(INSET_LEFT_BOTTOM_WIDTH_HEIGHT_SHARES, xlim=detail[0], ylim=detail[1])
    for line in axes.get_lines():
        inset.plot(*line.get_data(), color=line.get_color(), linestyle=line.get_linestyle(), linewidth=1.2)
    inset.grid(alpha=0.3)
    inset.tick_params(labelsize="small")
    axes.indicate_inset_zoom(inset)


def _reduce_png_palette(png: bytes) -> bytes:
    """Reduce the colours of a PNG to a palette; Pillow comes with matplotlib."""
    import io

    from PIL import Image

    sink = io.BytesIO()
    with Image.open(io.BytesIO(png)) as image:
        image.convert("RGB").quantize(N_PALETTE_COLOURS).save(sink, format="png", optimize=True)
    return sink.getvalue()
