"""CSV and TSV: separated text with a line of names.

Separator, decimal mark, line of names, line of units and encoding are found in the first lines. The rows are read by
Arrow, a few megabytes at a time.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cwcli.errors import DataError, InputError
from cwcli.importing.tables import Answers, ColumnsOfRows, Question, SourceTable
from cwcli.importing.text_file import MAX_LINE_CHARACTERS, TextHead, decode_text_head, no_text_error, read_head
from cwcli.importing.units import is_unit_text
from cwcli.lazy_dataclass import dataclass

SEPARATORS = (";", "\t", ",", "|")
"""Characters that separate cells, the ones that are never a decimal mark first. Blanks do where none of them does."""
N_START_LINES_SHOWING_LAYOUT = 200
"""Lines at the start that show the layout; chosen by hand."""
BYTES_PARSED_AT_ONCE = 4 << 20
"""Number of bytes that Arrow parses at a time, 4 MiB. Chosen by hand."""
MAX_COLUMNS = 20_000
"""Greatest number of columns: each takes 5 kB while Arrow reads. Chosen by hand: bus loggers write some thousand."""
_NUMBER = re.compile(r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$")
_VALUE = re.compile(r"^[+-]?[\d.,:/ TZeE+-]+$")
MAX_LINES_IN_QUOTED_CELL = 10
"""Greatest number of lines of a text in quotes. Chosen by hand."""
MAX_SHARE_OF_ROWS_WITH_WRONG_CELL_COUNT = 0.05
"""Largest share of rows with a wrong number of cells that are left out; more is an error. Chosen by hand."""
MAX_ROWS_WITH_WRONG_CELL_COUNT = 100_000
"""Greatest number of such rows, each of which takes 10 microseconds. Chosen by hand."""


@dataclass(frozen=True)
class TextLayout:
    """How a file of separated text is laid out.

    Attributes:
        separator: Character between cells.
        names: Names of the columns, each once.
        units: Column -> unit, from a line of units.
        n_head_lines: Lines before the first row.
        has_lines_in_cells: Whether texts in quotes go on in the next line.
    """

    separator: str
    names: tuple[str, ...]
    units: dict[str, str]
    n_head_lines: int
    has_lines_in_cells: bool = False


def read_delimited_table(
    path: str, answers: Answers, *, part: str = "", data: bytes | None = None, kind: str = "csv"
) -> SourceTable:
    """Return the table of a file.

    Args:
        answers: For a wish about the decimal mark.
        part: Name of the member of a zip that `data` is, or "".

    Raises:
        InputError: It is empty, no text, or has no rows.
        AmbiguousError: It has no line of names.
    """
    where = f"{path}: {part}" if part else path
    head = decode_text_head(read_head(path) if data is None else data[: 256 << 10])
    if head is None:
        raise no_text_error(where)
    layout = find_separator_names_and_units(head, where)
    notes: list[str] = []

    def read_column_batches(columns: Sequence[str]) -> Iterator[ColumnsOfRows]:
        return iter_text_rows(path if data is None else data, head, layout, columns, (where, notes))

    return SourceTable(path, part, kind, layout.names, read_column_batches, units=layout.units, notes=notes)


def find_separator_names_and_units(head: TextHead, where: str) -> TextLayout:
    """Find the separator, the names and the units.

    Raises:
        InputError: There are no lines or no rows.
        AmbiguousError: There is no line of names.
        DataError: No separator divides the lines alike.
    """
    numbered = _join_quoted_lines(
        [(k, line) for k, line in enumerate(head.lines[:N_START_LINES_SHOWING_LAYOUT]) if line.strip()]
    )
    if not numbered:
        raise InputError("it is empty", where=where)
    if re.fullmatch(r"sep=.", numbered[0][1].strip(), re.IGNORECASE):
        numbered = numbered[1:]
    best: tuple[float, int, str] | None = None
    for separator in SEPARATORS:
        rows = [_split_line_into_cells(line, separator) for _, line in numbered]
        counts = Counter(len(cells) for cells in rows[-max(len(rows) - 5, 1) :])
        n_cells, n_alike = max(counts.items(), key=lambda item: (item[1], item[0]))
        if n_cells < 2:
            continue
        has_names = any(len(cells) == n_cells and _are_cells_names(cells) for cells in rows)
        score = n_alike / sum(counts.values()) + (1.0 if has_names else 0.0)
        if best is None or score > best[0] + 1e-9:
            best = (score, n_cells, separator)
    if best is None and not head.encoding.startswith("utf-16"):
        counts = Counter(len(line.split()) for _, line in numbered)
        n_cells, n_alike = max(counts.items(), key=lambda item: item[1])
        best = (1.0, n_cells, " ") if n_cells > 2 and n_alike > 0.9 * len(numbered) else None
    if best is None:
        raise InputError(
            "its lines are not separated into columns",
            where=where,
            hint="columns are separated by , ; | tabs or blanks",
        )
    _, n_cells, separator = best
    return _layout_with_separator(separator, n_cells, numbered, where)


def _join_quoted_lines(numbered: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Return lines with the next ones behind those that end within quotes; each has the number of its last line.

    A quote that is not closed within a few lines is a mark of inches or seconds: its line stays as it is.
    """
    found: list[tuple[int, str]] = []
    at = 0
    while at < len(numbered):
        text = numbered[at][1]
        n_more = 0
        while text.count('"') % 2 and n_more < MAX_LINES_IN_QUOTED_CELL and at + n_more + 1 < len(numbered):
            n_more += 1
            text += "\n" + numbered[at + n_more][1]
        if text.count('"') % 2 or not re.search(r'(^|[,;\t|])"', text):
            n_more, text = 0, numbered[at][1]
        found.append((numbered[at + n_more][0], text))
        at += n_more + 1
    return found


def _layout_with_separator(separator: str, n_cells: int, numbered: Sequence[tuple[int, str]], where: str) -> TextLayout:
    rows = [(k, _split_line_into_cells(line, separator)) for k, line in numbered]
    at = next((i for i, (_, cells) in enumerate(rows) if len(cells) == n_cells and _are_cells_names(cells)), None)
    if at is not None and rows[at][1][0].startswith("#"):
        at = _plain_line_of_names_or(at, rows, n_cells)
    if at is None:
        at, rows = _rows_with_name_for_empty_end(rows, n_cells)
    if at is None:
        wide = next((cells for _, cells in rows if _are_cells_names(cells) and 1 < len(cells) < n_cells), None)
        if wide is not None and n_cells % len(wide) in (0, 1) and separator == ",":
            raise DataError(
                f"the line of names has {len(wide)} columns and the rows have {n_cells}: decimal commas between commas",
                where=where,
                hint="write it with ; or tabs between the columns, or with decimal points",
            )
        if wide is not None:
            raise DataError(
                f"the line of names has {len(wide)} columns and the rows have {n_cells}",
                where=where,
                hint="give every column a name",
            )
        shown = separator.join(rows[0][1])[:60]
        raise Question(
            where,
            f"it has no line of names; it begins with {shown!r}",
            "put a first line with the columns' names and units",
        ).as_error()
    names_line, names = rows[at]
    last = names_line
    units: dict[str, str] = {}
    unique = unique_names(names, where)
    if at + 1 < len(rows):
        k, cells = rows[at + 1]
        if (
            len(cells) == n_cells
            and any(is_unit_text(cell) for cell in cells)
            and not any(_NUMBER.match(cell) for cell in cells)
        ):
            units = {name: cell.strip("[]() ") for name, cell in zip(unique, cells, strict=True) if cell.strip()}
            last = k
    if last == rows[-1][0]:
        raise InputError("it has a line of names and no rows", where=where)
    return TextLayout(separator, unique, units, last + 1, any("\n" in line for _, line in numbered))


def _plain_line_of_names_or(at: int, rows: Sequence[tuple[int, list[str]]], n_cells: int) -> int:
    """Return the first line of names that is no comment, if it follows the comments; else `at`."""
    after = next((i for i, (_, cells) in enumerate(rows) if i > at and not (cells and cells[0].startswith("#"))), at)
    return after if len(rows[after][1]) == n_cells and _are_cells_names(rows[after][1]) else at


def _split_line_into_cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.lstrip("#% ").split()
    try:
        cells = next(csv.reader(line.splitlines(keepends=True), delimiter=separator), [])
    except csv.Error:
        return []
    return [cell.strip() for cell in cells]


def _rows_with_name_for_empty_end(
    rows: list[tuple[int, list[str]]], n_cells: int
) -> tuple[int | None, list[tuple[int, list[str]]]]:
    """Return the line of names, and the rows with an empty name more, where each row ends with a separator."""
    at = next((i for i, (_, cells) in enumerate(rows) if len(cells) == n_cells - 1 and _are_cells_names(cells)), None)
    if at is None or any(len(cells) != n_cells or cells[-1] for _, cells in rows[at + 1 :]):
        return None, rows
    return at, [(k, [*cells, ""] if len(cells) == n_cells - 1 else cells) for k, cells in rows]


class _TabsForBlanks(io.RawIOBase):
    """An open file whose runs of blanks are read as single tabs."""

    def __init__(self, file: Any, where: str) -> None:
        self.file, self.where = file, where

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        data: bytes = self.file.read(size)
        if not data.endswith(b"\n"):
            data += self.file.readline(MAX_LINE_CHARACTERS)
        lines = data.splitlines()
        if max(map(len, lines), default=0) >= MAX_LINE_CHARACTERS:
            raise InputError(f"a line has more than {MAX_LINE_CHARACTERS - 1:,} characters", where=self.where)
        return b"".join(b"\t".join(line.split()) + b"\n" for line in lines)


def _are_cells_names(cells: Sequence[str]) -> bool:
    """Tell whether cells are names: most are words, and none is a number or a time."""
    filled_cells = [cell.lstrip("#").strip() for cell in cells if cell.strip()]
    if not filled_cells or any(_NUMBER.match(cell) for cell in filled_cells):
        return False
    words = [cell for cell in filled_cells if re.search(r"[^\W\d]", cell) and not _VALUE.match(cell)]
    return len(words) > 0.5 * len(cells) and len(set(filled_cells)) > 0.5 * len(filled_cells)


def unique_names(cells: Sequence[str], where: str) -> tuple[str, ...]:
    """Return each name once: empty ones get a number, repeated ones a number behind them.

    Raises:
        InputError: There are more than `MAX_COLUMNS`.
    """
    if len(cells) > MAX_COLUMNS:
        raise InputError(f"it has {len(cells):,} columns, more than {MAX_COLUMNS:,}", where=where)
    seen: Counter[str] = Counter()
    names = []
    for k, cell in enumerate(cells):
        name = cell.lstrip("#").strip() or f"column {k + 1}"
        seen[name] += 1
        names.append(name if seen[name] == 1 else f"{name} #{seen[name]}")
    return tuple(names)


def iter_text_rows(
    source: str | bytes,
    head: TextHead,
    layout: TextLayout,
    columns: Sequence[str],
    where_and_notes: tuple[str, list[str]],
) -> Iterator[ColumnsOfRows]:
    """Yield the rows, all cells as text."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv as arrow_csv

    where, notes = where_and_notes
    n_bad, longest = [0], [""]

    def count_and_skip_row(row: Any) -> str:
        n_bad[0] += 1
        longest[0] = max(longest[0], row.text or "", key=lambda text: text.count("\n"))
        return "skip" if n_bad[0] <= MAX_ROWS_WITH_WRONG_CELL_COUNT else "error"  # Arrow passes no error of ours on

    n_rows = 0
    with io.BytesIO(source) if isinstance(source, bytes) else Path(source).open("rb") as file:
        for _ in range(1 if head.bom_bytes else 0):
            file.seek(head.bom_bytes)
        _skip_lines(file, head, layout.n_head_lines)
        try:
            reader = arrow_csv.open_csv(
                _TabsForBlanks(file, where) if layout.separator == " " else file,
                read_options=arrow_csv.ReadOptions(
                    column_names=list(layout.names),
                    encoding=head.encoding,
                    block_size=BYTES_PARSED_AT_ONCE,
                    use_threads=False,
                ),
                parse_options=arrow_csv.ParseOptions(
                    delimiter=layout.separator.replace(" ", "\t"),
                    quote_char=False if layout.separator == " " else '"',
                    newlines_in_values=layout.has_lines_in_cells,
                    invalid_row_handler=count_and_skip_row,
                ),
                convert_options=arrow_csv.ConvertOptions(
                    column_types=dict.fromkeys(layout.names, pa.string()),
                    include_columns=list(columns),
                    strings_can_be_null=False,
                ),
            )
            for batch in reader:
                n_rows += len(batch)
                for name in columns:
                    for text in pc.filter(batch.column(name), pc.match_substring(batch.column(name), "\n")):
                        _require_closed_quotes(text.as_py(), where)
                yield {name: batch.column(name) for name in columns}
        except (pa.ArrowInvalid, UnicodeError) as error:
            said = str(error).splitlines()[0]
            if n_bad[0] > MAX_ROWS_WITH_WRONG_CELL_COUNT:
                said = f"more than {MAX_ROWS_WITH_WRONG_CELL_COUNT:,} rows have not {len(layout.names)} columns"
            if n_rows == 0 and n_bad[0] == 0 and "Empty" in said:
                raise InputError("it has a line of names and no rows", where=where) from error
            raise InputError(f"it can't be read as separated text: {said}", where=where) from error
    _require_closed_quotes(longest[0], where)
    if n_bad[0] > MAX_SHARE_OF_ROWS_WITH_WRONG_CELL_COUNT * (n_rows + n_bad[0]):
        raise DataError(
            f"{n_bad[0]} of {n_rows + n_bad[0]} rows have not {len(layout.names)} columns",
            where=where,
            hint="decimal commas between commas, or another separator further down",
        )
    if n_bad[0]:
        said = f"{n_bad[0]} rows have another number of columns and are left out"
        if said not in notes:
            notes.append(said)


def _require_closed_quotes(text: str, where: str) -> None:
    """Raise where a row or a cell holds many lines: a quote that is never closed has swallowed other rows.

    Raises:
        DataError: It does.
    """
    n_lines = text.count("\n")
    if n_lines > MAX_LINES_IN_QUOTED_CELL:
        raise DataError(
            f"a quote is opened and not closed: {n_lines} lines would be one cell, which begins {text[:40]!r}",
            where=where,
            hint='remove the "',
        )


def _skip_lines(file: Any, head: TextHead, n: int) -> None:
    """Move an open file behind its first n lines (`\\n`, `\\r\\n` or `\\r`)."""
    start = file.tell()
    unit = 2 if head.encoding.startswith("utf-16") else 1
    text = file.read(1 << 20).decode(head.encoding, "replace")
    at = 0
    for line in text.splitlines(keepends=True)[:n]:
        at += len(line)
    skipped = text[:at].encode(head.encoding, "replace")
    file.seek(start + (len(skipped) if unit == 2 or head.encoding == "utf-8" else at))
