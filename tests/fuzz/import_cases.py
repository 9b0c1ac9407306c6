"""Cases of the levels `nmea`, `ubx`, `csv`, `gpx`, `kml`, `rtklib`, `vbox` and `can`: mutated files for `cwcli import`.

The rows of a reader are compared with those of another library: pynmea2, pyubx2, Python's csv and ElementTree, and
python-can with cantools; of RTKLIB and VBOX with those of a plain reader. They are the same in the same order, but for
those that the reader counts as left out.
"""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import isclose, isnan
from pathlib import Path

from cwcli.errors import CwcliError
from cwcli.importing.readers import load_kind
from cwcli.importing.readers.base import FileHead
from cwcli.importing.run import plan_import
from cwcli.importing.tables import Answers, SourceTable
from tests.fuzz import import_oracles as oracles
from tests.fuzz import track_oracles
from tests.fuzz.file_cases import fast_folder
from tests.fuzz.import_oracles import NAN, Row, Tables
from tests.fuzz.mutate import NUMBERS, Rng, mutate
from tests.unit.importing import files, other_tables, real_files, real_tables

N_INPUTS = 4
WITH_PLAN = 0.25
"""The share of files that go the whole way of `cwcli import`, which takes longer than the reader."""
N_ROWS = 30
NS_PER_DAY = 86_400 * 10**9
TEXT_TOKENS = (
    *(b",", b";", b"\n", b"\r", b'"', b"'", b" ", b"-", b".", b"0", b"9" * 400, b"1e400", b"nan", b"\xff", b"\x00"),
    *(b"N", b"S", b"E", b"W", b"A", b"V", b"*", b"$", b"!", b"M", b"T", b"000000", b"240000", b"180.0", b"-91"),
)
XML_TOKENS = (*TEXT_TOKENS, b"<", b">", b"/>", b"<trkpt>", b"</trkpt>", b"<!--", b"-->", b"<![CDATA[", b"&amp;", b"&a;")
DBC_TOKENS = (*TEXT_TOKENS, b"|", b"@", b"1+", b"0-", b"64", b"(0,0)", b"m0 ", b"M ", b"SG_ ", b"BO_ ", b"VAL_ ", b"65")


@dataclass(frozen=True)
class Family:
    """Files of one kind.

    Attributes:
        names: Name of each file, the one with the rows first; the others are read with it.
        base: Content of each file.
        tokens: What is put into them.
        official: The rows by another library, of the files below a folder; None if it refuses them.
        mend: What becomes of a mutated file, so that more of them are read.
    """

    kind: str
    names: tuple[str, ...]
    base: Callable[[], tuple[bytes, ...]]
    tokens: Sequence[bytes]
    official: Callable[[list[Path], Sequence[SourceTable]], Tables | None]
    mend: Callable[[bytes], bytes] = bytes


def _check(rng: Rng, families: Sequence[Family]) -> dict[str, int]:
    """Mutate files and check each; counts of inputs."""
    counts: Counter[str] = Counter()
    for _ in range(N_INPUTS):
        family = families[int(rng.integers(len(families)))]
        contents = list(family.base())
        k = int(rng.integers(len(contents)))
        contents[k] = mutate(rng, contents[k], family.tokens)
        if k == 0 and rng.random() < 0.7:
            contents[0] = family.mend(contents[0])
        with tempfile.TemporaryDirectory(dir=fast_folder()) as folder:
            paths = [Path(folder) / name for name in family.names]
            for path, content in zip(paths, contents, strict=True):
                path.write_bytes(content)
            check_files(family, paths, counts, with_plan=rng.random() < WITH_PLAN)
    return dict(counts)


def check_files(family: Family, paths: list[Path], counts: Counter[str], *, with_plan: bool = False) -> None:
    """Compare the rows of files, and now and then plan their import.

    Raises:
        AssertionError: A row is another one, or is missing and not counted.
    """
    counts["inputs"] += 1
    if with_plan:
        try:
            plan_import([*map(str, paths)], Answers())
        except CwcliError as error:
            assert "\n" not in str(error)
    answers = Answers(dbc=tuple(map(str, paths[1:])))
    kind = load_kind(family.kind)
    if not kind.accepts(FileHead(str(paths[0]))):
        return
    try:
        tables = [each for each in kind.read(str(paths[0]), answers) if isinstance(each, SourceTable)]
        found = {table.part: list(rows_of(table)) for table in tables}
    except CwcliError as error:
        assert "\n" not in str(error)
        return
    counts["accepted"] += 1
    official = family.official(paths, tables)
    if official is None:
        return
    counts["compared"] += 1
    n_counted = sum(
        int(n) for table in tables for note in table.notes for n in re.findall(r"\b(\d+)\b(?! columns)", note)
    )
    counts["counted"] += n_counted > 0
    for part, rows in found.items():
        n_missing = missing_rows(rows, official.get(part, []))
        assert n_missing <= n_counted, (part, f"{n_missing} rows are missing, {n_counted} are counted")


def rows_of(table: SourceTable) -> Iterator[Row]:
    """All rows of a table, in the order of its columns; of the times of NMEA the time of day."""
    for batch in table.read_batches(table.columns):
        columns = [batch[name] for name in table.columns]
        if table.kind == "nmea":
            columns[0] = columns[0] % NS_PER_DAY
        cells = ([NAN if cell is None else cell for cell in each.tolist()] for each in columns)
        yield from zip(*cells, strict=True)


def missing_rows(rows: Sequence[Row], expected: Sequence[Row]) -> int:
    """The number of expected rows that are not there.

    Raises:
        AssertionError: There is a row that is not expected at its place.
    """
    at = 0
    for row in rows:
        begin = at
        while at < len(expected) and not are_rows_equal(row, expected[at]):
            at += 1
        assert at < len(expected), ("not a row of the file", row, expected[begin : begin + 1])
        at += 1
    return len(expected) - len(rows)


def are_rows_equal(row: Row, expected: Row) -> bool:
    """Whether texts are the same, and numbers but for their last digits; None stands for any value."""
    return all(
        other is None
        or value == other
        or (isinstance(value, float) and isinstance(other, float) and _are_numbers_equal(value, other))
        for value, other in zip(row, expected, strict=True)
    )


def _are_numbers_equal(value: float, other: float) -> bool:
    return (isnan(value) and isnan(other)) or isclose(value, other, rel_tol=1e-12, abs_tol=1e-11)


@cache
def _content(make: Callable[[Path], list[Path]], n_lines: int | None = None) -> tuple[bytes, ...]:
    """The files that the tests of `cwcli import` make; of a text its first lines."""
    with tempfile.TemporaryDirectory() as folder:
        first, *others = (path.read_bytes() for path in make(Path(folder)))
    return (first if n_lines is None else b"".join(first.splitlines(keepends=True)[:n_lines]), *others)


def _gpx() -> tuple[bytes, ...]:
    return (_content(files.gpx_speed, 2 + N_ROWS)[0] + b"</trkseg></trk></gpx>",)


def _kml(make: Callable[[Path], list[Path]]) -> tuple[bytes, ...]:
    """A file of `N_ROWS` times and places: the tests' without those in the middle."""
    data = _content(make)[0]
    for each in (rb"<when>[^<]*</when>", rb"<gx:coord>[^<]*</gx:coord>"):
        spans = [found.span() for found in re.finditer(each, data)]
        for begin, end in spans[-N_ROWS // 2 - 1 : N_ROWS // 2 - 1 : -1]:
            data = data[:begin] + data[end:]
    return (data,)


def _with_checksums(data: bytes) -> bytes:
    """NMEA sentences whose checksums are right again."""

    def mended(match: re.Match[bytes]) -> bytes:
        total = 0
        for octet in match[1]:
            total ^= octet
        return b"$%b*%02X" % (match[1], total)

    return re.sub(rb"\$([^$*\r\n]*)\*[0-9A-Fa-f]{2}", mended, data)


NMEA = (
    Family(
        "nmea", ("a.nmea",), lambda: _content(files.nmea_full, 3 * N_ROWS), TEXT_TOKENS, oracles.nmea, _with_checksums
    ),
    Family("nmea", ("a.nmea",), lambda: _content(files.nmea_rmc, N_ROWS), TEXT_TOKENS, oracles.nmea, _with_checksums),
)
UBX = (
    Family(
        "ubx",
        ("a.ubx",),
        lambda: (_content(files.ubx)[0][: 100 * N_ROWS],),
        (*NUMBERS, b"\xb5\x62", b"\xb5\x62\x01\x07\x5c\x00"),
        oracles.ubx,
        oracles.with_ubx_checksums,
    ),
)
CSV = tuple(
    Family("csv", ("a.csv",), lambda make=make: _content(make, N_ROWS), TEXT_TOKENS, oracles.csv_rows)  # type: ignore[misc]
    for make in (files.csv_logger, files.csv_german, files.csv_quoted_commas, files.tsv_iso, files.csv_units_row)
)
GPX = (Family("gpx", ("a.gpx",), _gpx, XML_TOKENS, oracles.gpx),)
KML_TOKENS = (
    *XML_TOKENS,
    b"<when>",
    b"</when>",
    b"<gx:coord>",
    b"</gx:coord>",
    b"<gx:Track>",
    b"</gx:Track>",
    b"+",
    b"e5",
)
KML = tuple(
    Family("kml", ("a.kml",), lambda make=make: _kml(make), KML_TOKENS, track_oracles.kml)  # type: ignore[misc]
    for make in (real_files.kml_track, real_files.kml_tracks_in_pairs)
)
CLOCK_TOKENS = (*TEXT_TOKENS, b"+", b"e5", b"  ", b"\t", b"235959.9 ", b"240000 ", b"00:00:60", b"2016/12/31 23:59:60")
RTKLIB = tuple(
    Family("rtklib", ("a.pos",), lambda make=make: _content(make, N_ROWS), CLOCK_TOKENS, track_oracles.rtklib)  # type: ignore[misc]
    for make in (real_tables.rtklib_gpst, real_tables.rtklib_velocity, other_tables.rtklib)
)
VBOX = tuple(
    Family("vbox", ("a.vbo",), lambda make=make: _content(make, 2 * N_ROWS), CLOCK_TOKENS, track_oracles.vbox)  # type: ignore[misc]
    for make in (real_tables.racechrono_vbo, other_tables.vbo)
)
CAN = tuple(
    Family(kind, (name, "car.dbc"), lambda make=make, n=n: _content(make, n), tokens, oracles.can)  # type: ignore[misc]
    for kind, name, make, n, tokens in (
        ("asc", "a.asc", files.can_asc, 3 * N_ROWS, (*DBC_TOKENS, b" 100 ", b" 200 ", b"Rx", b"d 8", b"CANFD")),
        ("candump", "a.log", files.can_dump, 3 * N_ROWS, (*DBC_TOKENS, b"#", b"##", b"100#", b"(", b")", b"R")),
        (
            "trc",
            "a.trc",
            files.can_trc,
            3 * N_ROWS,
            (*DBC_TOKENS, b";$COLUMNS=", b"0100 ", b"DT", b"RR", b"Rx"),
        ),
        ("blf", "a.blf", files.can_blf, None, (*NUMBERS, b"LOBJ", b"LOGG", b"\n BO_ 256 X: 8 E\n")),
    )
)


def check_nmea(rng: Rng) -> dict[str, int]:
    """Sentences of NMEA 0183."""
    return _check(rng, NMEA)


def check_ubx(rng: Rng) -> dict[str, int]:
    """Messages of u-blox."""
    return _check(rng, UBX)


def check_csv(rng: Rng) -> dict[str, int]:
    """Separated text."""
    return _check(rng, CSV)


def check_gpx(rng: Rng) -> dict[str, int]:
    """GPX tracks."""
    return _check(rng, GPX)


def check_kml(rng: Rng) -> dict[str, int]:
    """KML tracks."""
    return _check(rng, KML)


def check_rtklib(rng: Rng) -> dict[str, int]:
    """Positions of RTKLIB."""
    return _check(rng, RTKLIB)


def check_vbox(rng: Rng) -> dict[str, int]:
    """VBOX files."""
    return _check(rng, VBOX)


def check_can(rng: Rng) -> dict[str, int]:
    """CAN traces and the DBC file that explains them."""
    return _check(rng, CAN)
