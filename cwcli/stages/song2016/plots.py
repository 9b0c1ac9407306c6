"""The redrawn figures as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cwcli.errors import UsageError
from cwcli.output import write_file
from cwcli.stages.findings import Plot

FORMATS = ("png", "svg")


def write_plots(plots: Sequence[Plot], folder: str, *, file_format: str, force: bool = False) -> list[str]:
    """Draw each plot into `<folder>/<figure>.<format>`; the folder must exist.

    Returns:
        The files' names.

    Raises:
        UsageError: matplotlib is not installed, or an unknown format.
        OutputError: A file can't be written.
    """
    if file_format not in FORMATS:
        raise UsageError(f"there is no plot format '{file_format}'", hint=f"one of: {', '.join(FORMATS)}")
    try:
        import matplotlib as mpl
    except ImportError as error:
        raise UsageError("plots need matplotlib", hint="pip install 'cwcli[plots]'") from error
    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "cwcli"  # the same input gives the same bytes
    return [_write(plot, Path(folder), file_format, force) for plot in plots]


def _write(plot: Plot, folder: Path, file_format: str, force: bool) -> str:
    import io

    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.add_subplot()
    for curve in plot.curves:
        axes.plot(curve.x, curve.y, label=curve.label, linewidth=1.2)
    for label, x in plot.marks.items():
        axes.axvline(x, color="black", linestyle=":", linewidth=1.0, label=label)
    if plot.level is not None:
        label, y = plot.level
        axes.axhline(y, color="black", linestyle="--", linewidth=1.0, label=label)
    axes.set_title(f"song2016 {plot.figure}. {plot.title}", fontsize="medium")
    axes.set_xlabel(plot.x_label)
    axes.set_ylabel(plot.y_label)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    sink = io.BytesIO()
    metadata = {"Date": None} if file_format == "svg" else {"Software": "cwcli"}
    figure.savefig(sink, format=file_format, dpi=110, metadata=metadata)
    path = folder / f"{plot.figure.replace(' ', '-')}.{file_format}"
    write_file(path, memoryview(sink.getvalue()), force=force)
    return str(path)
