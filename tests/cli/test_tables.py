"""Tables fit 80 columns, or the terminal, whatever is in them; in a pipe topics stay whole."""

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cwcli.cli.tables import format_table
from cwcli.cli.text import terminal_cells_of_text
from tests.cli.conftest import ROOT


def test_table_aligns_numbers_right_and_text_left() -> None:
    shown = format_table(("sensor", "n", "error m"), [("gnss", 12, 0.5), ("imu", 3456, None)])
    assert shown.split("\n") == [
        "sensor     n  error m",
        "------  ----  -------",
        "gnss      12   0.5000",
        "imu     3456        -",
    ]


def test_table_wraps_long_text_cells() -> None:
    shown = format_table(("topic", "schema", "n"), [("/a" * 30, "package/msg/" + "Long" * 15, 5)])
    lines = shown.split("\n")
    assert max(map(terminal_cells_of_text, lines)) <= 80
    assert "".join(line[:38].rstrip() for line in lines[2:]).startswith("/a/a/a")


def test_headings_and_words_are_wrapped_before_a_name_is_broken() -> None:
    columns = ("metric", "value before the change", "what happened", "number of logs compared")
    name = "ego.online_heading_rmse_deg_of_all_logs"
    lines = format_table(columns, [(name, 0.25, "it is as good as before", 3)], width=80).split("\n")
    assert max(map(len, lines)) <= 80
    assert any(line.startswith(name) for line in lines)
    assert {"it", "is", "as", "good", "before"} <= set("\n".join(lines).split())


def test_table_with_too_many_columns_repeats_the_first_in_each_part() -> None:
    columns = ("name", *(f"value {i}" for i in range(30)))
    shown = format_table(columns, [("row", *(1000.25 + i for i in range(30)))])
    blocks = shown.split("\n\n")
    assert len(blocks) > 1
    assert all(block.split("\n")[-1].startswith("row ") for block in blocks)
    assert shown.count("10") >= 30


def test_table_in_parts_repeats_every_column_that_tells_the_rows_apart() -> None:
    """Two rows of /imu/data differ in their quantity alone: each part names it."""
    columns = ("source", "quantity", *(f"value {i}" for i in range(12)))
    rows = [("/imu/data", quantity, *(1000.25 + i for i in range(12))) for quantity in ("accel", "yaw rate")]
    blocks = format_table(columns, rows, width=80).split("\n\n")
    assert len(blocks) > 1
    assert all([line.split()[:2] for line in block.split("\n")[-2:]] == [["/imu/data", "accel"], ["/imu/data", "yaw"]]
               for block in blocks)  # fmt: skip
    numbers = [(1, policy, *(1000.25 + i for i in range(12))) for policy in ("none", "fuzzy")]
    blocks = format_table(("event", "policy", *columns[2:]), numbers, width=80).split("\n\n")
    assert all([line.split()[1] for line in block.split("\n")[-2:]] == ["none", "fuzzy"] for block in blocks)


def test_table_without_rows_shows_its_headings() -> None:
    assert format_table(("a", "b"), []) == "a  b\n-  -"


def test_table_escapes_control_characters() -> None:
    assert "\x1b" not in format_table(("topic\x1b",), [("/evil\x1b[2J",)])


def test_table_of_words_wider_than_the_terminal() -> None:
    lines = format_table(("a" * 90, "b" * 300, "c"), [("x" * 90, "y" * 300, 1)]).split("\n")
    assert max(map(len, lines)) <= 80
    assert sum(line.count("y") for line in lines) == 300


@given(
    st.lists(st.text(min_size=1, max_size=60), min_size=1, max_size=12).flatmap(
        lambda heads: st.tuples(
            st.just(heads),
            st.lists(
                st.tuples(*(st.one_of(st.none(), st.text(max_size=120), st.integers(), st.floats()) for _ in heads)),
                max_size=4,
            ),
        )
    )
)
def test_table_fits_80_columns(made: tuple[list[str], list[tuple[str | float | int | None, ...]]]) -> None:
    heads, rows = made
    lines = format_table(heads, rows, width=80).split("\n")
    assert max(terminal_cells_of_text(line) for line in lines) <= 80


@pytest.mark.parametrize("width", [20, 40, 120])
def test_table_fits_other_widths(width: int) -> None:
    rows = [("/v2x/cam/front/left", "etsi_its_cam_msgs/msg/CAM", 330, 9.98)]
    shown = format_table(("topic", "schema", "messages", "Hz"), rows, width=width)
    assert max(map(len, shown.split("\n"))) <= width


TOPIC = "/vehicle/body/wheel_speed_sensor_front_left"


def printed_on_a_terminal(n_columns: int) -> list[str]:
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, n_columns, 0, 0))
    rows = [(TOPIC, "word " * 20)]
    code = f"from cwcli.cli.tables import format_table; print(format_table(('topic', 'what'), {rows!r}))"
    done = subprocess.Popen([sys.executable, "-c", code], stdout=slave, cwd=ROOT)
    assert done.wait(timeout=600) == 0
    os.close(slave)
    text = os.read(master, 100_000).decode()
    os.close(master)
    return text.replace("\r\n", "\n").splitlines()


def test_a_table_is_as_wide_as_its_terminal() -> None:
    assert [len(line) for line in printed_on_a_terminal(150)] == [len(TOPIC) + 6, len(TOPIC) + 102, len(TOPIC) + 101]
    narrow = printed_on_a_terminal(40)
    assert max(map(len, narrow)) == 40
    assert max(map(len, printed_on_a_terminal(3))) <= 20  # as narrow as it gets


def test_a_topic_is_whole_in_a_pipe_even_where_the_line_gets_too_long() -> None:
    lines = format_table(("topic", "what"), [(TOPIC, "some words that are many " * 3)]).splitlines()
    assert any(line.startswith(TOPIC) for line in lines)
    long = "/a" * 60
    assert any(line.startswith(long) for line in format_table(("topic", "n"), [(long, 3)]).splitlines())
    assert max(map(terminal_cells_of_text, format_table(("topic", "n"), [(long, 3)], width=80).splitlines())) <= 80
