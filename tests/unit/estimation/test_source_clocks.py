"""Clocks of sources against the log's: steps, offsets, and what is no fault of a clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cwcli.estimation.measurements import Kind, Measurements
from cwcli.estimation.source_clocks import align_source_clocks_and_note, notes_on_hidden_clock_steps
from tests.unit.estimation.made_drive import made_drive

NS = 1_000_000_000
EPOCH_NS = 1_700_000_000 * NS


def drive(*, delays_s: Sequence[float] = (0.08, 0.005, 0.02)) -> list[Measurements]:
    """Fixes of 0.3 m, a speed and a yaw rate of the drive by hand; two minutes."""
    time_s, values = made_drive()
    rng = np.random.default_rng(0)
    stamp_ns = EPOCH_NS + np.rint(time_s * 1e9).astype(np.int64)
    of = {Kind.POSITION: (2, 0.3), Kind.SPEED: (1, 0.1), Kind.YAW_RATE: (1, 0.01)}
    found = []
    for (kind, (every, sigma)), delay_s in zip(of.items(), delays_s, strict=True):
        own = values[kind][::every]
        jitter_s = 0.01 * rng.random(len(own))
        log_ns = stamp_ns[::every] + np.rint((delay_s + jitter_s) * 1e9).astype(np.int64)
        noisy = own + sigma * rng.standard_normal(own.shape)
        found.append(Measurements(f"/{kind.name.lower()}", kind, stamp_ns[::every], noisy, None, log_ns))
    return found


def with_stamps(m: Measurements, change_s: np.ndarray | float) -> Measurements:
    return replace(m, stamp_ns=m.stamp_ns + np.rint(np.asarray(change_s) * 1e9).astype(np.int64))


@pytest.mark.parametrize("step_s", [3.0, -3.0, 0.5, 18.0, 3600.0])
@pytest.mark.parametrize("begin", [60, 300, 1100])
def test_a_clock_that_steps_in_mid_log_is_set_back(step_s: float, begin: int) -> None:
    fixes, *others = drive()
    late = np.where(np.arange(len(fixes)) >= begin, step_s, 0.0)
    aligned, notes = align_source_clocks_and_note([with_stamps(fixes, late), *others])
    np.testing.assert_allclose((aligned[0].stamp_ns - fixes.stamp_ns) / NS, 0.0, atol=0.01)
    assert aligned[1:] == others
    (note,) = notes
    assert note.startswith(f"/position: its clock is {step_s:+.2f}"[:-1])


@pytest.mark.parametrize("rate", [1000.0, 1e-3, 0.5, 1.04])  # of 104 Hz counted as 100 Hz, too
def test_stamps_in_another_unit_give_way_to_the_log_times(rate: float) -> None:
    *others, rates = drive()
    wrong = replace(rates, stamp_ns=EPOCH_NS + np.rint((rates.stamp_ns - EPOCH_NS) * rate).astype(np.int64))
    aligned, (note,) = align_source_clocks_and_note([*others, wrong])
    np.testing.assert_array_equal(aligned[2].stamp_ns, rates.received_ns)
    assert aligned[:2] == others
    assert note.startswith(f"/yaw_rate: its stamps run {rate:.3g} times as fast as the log")
    kept, notes = align_source_clocks_and_note([*others, wrong], trusted=["/yaw_rate"])
    assert kept[2] is wrong
    assert not any("times as fast" in note for note in notes)


def test_log_times_of_a_converted_log_do_not_make_all_stamps_wrong() -> None:
    """Where all messages were logged within a second, the stamps are all that is known of the time."""
    fast = [replace(m, log_time_ns=EPOCH_NS + (m.received_ns - EPOCH_NS) // 100) for m in drive()]
    _, notes = align_source_clocks_and_note(fast)
    assert not any("times as fast" in note for note in notes)


def test_a_clock_that_is_off_for_a_piece_is_set_right_there() -> None:
    fixes, *others = drive()
    piece = (np.arange(len(fixes)) >= 300) & (np.arange(len(fixes)) < 700)
    (aligned, *_), (note,) = align_source_clocks_and_note([with_stamps(fixes, np.where(piece, -2.0, 0.0)), *others])
    np.testing.assert_allclose((aligned.stamp_ns - fixes.stamp_ns) / NS, 0.0, atol=0.01)
    assert "for 40 s (400 messages)" in note


@pytest.mark.parametrize("offset_s", [1.0, 18.0, 3600.0, -1.0, -18.0, -3600.0])
def test_a_constant_offset_of_whole_seconds_is_taken_off(offset_s: float) -> None:
    fixes, *others = drive()
    (aligned, *_), (note,) = align_source_clocks_and_note([with_stamps(fixes, offset_s), *others])
    np.testing.assert_array_equal(aligned.stamp_ns, fixes.stamp_ns)
    assert note.startswith(f"/position: its clock is {offset_s:+.2f} s off")


def test_of_two_sources_the_one_that_is_off_the_log_times_moves() -> None:
    fixes, speed, _ = drive()
    aligned, _ = align_source_clocks_and_note([fixes, with_stamps(speed, 18.0)])
    np.testing.assert_array_equal(aligned[0].stamp_ns, fixes.stamp_ns)
    np.testing.assert_array_equal(aligned[1].stamp_ns, speed.stamp_ns)


@pytest.mark.parametrize("offset_s", [18.0, -18.0, -2.0])
def test_two_topics_of_one_receiver_are_outvoted_by_the_log_times(offset_s: float) -> None:
    """Two topics on another clock, and two on the log's."""
    fixes, speed, yaw_rate = drive()
    heading = made_drive()[1][Kind.HEADING] + 0.02 * np.random.default_rng(1).standard_normal(len(speed))
    course = replace(speed, source="/course", kind=Kind.HEADING, values=heading, log_time_ns=speed.stamp_ns + NS // 12)
    aligned, notes = align_source_clocks_and_note(
        [with_stamps(fixes, offset_s), with_stamps(course, offset_s), speed, yaw_rate]
    )
    for own, right in zip(aligned, [fixes, course, speed, yaw_rate], strict=True):
        np.testing.assert_array_equal(own.stamp_ns, right.stamp_ns)
    assert len(notes) == 2


@pytest.mark.parametrize(
    "delays_s", [(0.08, 0.005, 0.02), (1.0, 0.0, 0.0), (2.3, 0.1, 0.1), (0.1, 0.6, 0.1), (86400.0, 86400.1, 86400.2)]
)
def test_late_messages_and_a_log_that_was_written_later_change_nothing(delays_s: Sequence[float]) -> None:
    given = drive(delays_s=delays_s)
    aligned, notes = align_source_clocks_and_note(given)
    assert aligned == given
    assert notes == []


def test_a_recorder_that_stalls_changes_nothing() -> None:
    """For 4 s nothing is logged, then all of it at once."""
    given = []
    for m in drive():
        log_s = (m.received_ns - EPOCH_NS) / NS
        stalled_s = np.where((log_s > 50.0) & (log_s < 54.0), 54.0 + 0.02 * (log_s - 50.0), log_s)
        given.append(replace(m, log_time_ns=EPOCH_NS + np.rint(stalled_s * 1e9).astype(np.int64)))
    aligned, notes = align_source_clocks_and_note(given)
    assert aligned == given
    assert notes == []


def test_fixes_that_pause_in_a_tunnel_keep_their_stamps() -> None:
    fixes, *others = drive()
    fixes = fixes.select_rows(np.abs((fixes.stamp_ns - EPOCH_NS) / NS - 60.0) > 5.0)
    reception = replace(fixes, log_time_ns=fixes.stamp_ns)
    for own in (fixes, reception):
        aligned, notes = align_source_clocks_and_note([own, *others])
        assert aligned == [own, *others]
        assert notes == []


def test_a_step_of_the_logs_clock_is_taken_off_the_stamps_that_it_makes() -> None:
    """The clock of log times, speed and yaw rate jumps by 3 s; the receiver's runs on."""
    fixes, *others = drive()
    begin_ns = EPOCH_NS + 60 * NS

    def late(ns: np.ndarray) -> np.ndarray:
        return ns + 3 * NS * (ns >= begin_ns)

    given = [
        replace(fixes, log_time_ns=late(fixes.received_ns)),
        *(replace(m, stamp_ns=late(m.stamp_ns), log_time_ns=late(m.received_ns)) for m in others),
    ]
    aligned, notes = align_source_clocks_and_note(given)
    for own, right in zip(aligned, [fixes, *others], strict=True):
        np.testing.assert_allclose((own.stamp_ns - right.stamp_ns) / NS, 0.0, atol=0.02)
    assert len(notes) == 2
    assert "the log's clock steps by +3.00 s against /position" in notes[0]


def test_a_step_of_the_logs_clock_that_two_receivers_show_is_taken_off_once() -> None:
    """Two sources keep their own clocks, so that both show the same step of 3 s; the yaw rate's stamps make it."""
    *own, yaw_rate = drive()
    begin_ns = EPOCH_NS + 60 * NS

    def late(ns: np.ndarray) -> np.ndarray:
        return ns + 3 * NS * (ns >= begin_ns)

    given = [
        *(replace(m, log_time_ns=late(m.received_ns)) for m in own),
        replace(yaw_rate, stamp_ns=late(yaw_rate.stamp_ns), log_time_ns=late(yaw_rate.received_ns)),
    ]
    aligned, notes = align_source_clocks_and_note(given)
    for each, right in zip(aligned, [*own, yaw_rate], strict=True):
        np.testing.assert_allclose((each.stamp_ns - right.stamp_ns) / NS, 0.0, atol=0.02)
    (note,) = notes
    assert note.startswith("/yaw_rate: the log's clock steps by +3.00 s against /position")


def test_stamps_that_are_trusted_are_told_and_stay() -> None:
    fixes, *others = drive()
    given = [with_stamps(fixes, 18.0), *others]
    aligned, (note,) = align_source_clocks_and_note(given, corrects=False)
    assert aligned == given
    assert note.endswith("not corrected, because the stamps are trusted")
    assert align_source_clocks_and_note(given, trusted=["/position"]) == (given, [])


def test_only_stamps_that_are_log_times_hide_a_step() -> None:
    fixes, *_ = drive()
    assert notes_on_hidden_clock_steps([fixes], ["/position"]) == []
    (note,) = notes_on_hidden_clock_steps([replace(fixes, log_time_ns=fixes.stamp_ns)], ["/position"])
    assert "a step of its clock cannot be seen" in note


def test_stamps_that_are_cut_to_seconds_are_replaced_by_the_log_times() -> None:
    fixes, *others = drive()
    cut = replace(fixes, stamp_ns=fixes.stamp_ns // NS * NS)
    (aligned, *_), (note,) = align_source_clocks_and_note([cut, *others])
    # The least delay is that of the stamps on a whole second: 0.08 s and up to 0.01 s of jitter.
    np.testing.assert_allclose((aligned.stamp_ns - fixes.stamp_ns) / NS, 0.0, atol=0.011)
    assert note.startswith("/position: its stamps are cut to 1 s; the log times less 0.08")
    assert align_source_clocks_and_note([cut, *others], trusted=["/position"])[0][0] is cut


def test_stamps_that_are_cut_to_seconds_are_no_other_rate_in_a_short_log() -> None:
    """In 36 s the median step of a tenth of the stamps is 4 s and of the log times 3.6 s."""
    fixes, *others = [m.select_rows(m.stamp_ns < EPOCH_NS + 36 * NS) for m in drive()]
    _, (note,) = align_source_clocks_and_note([replace(fixes, stamp_ns=fixes.stamp_ns // NS * NS), *others])
    assert note.startswith("/position: its stamps are cut to 1 s")


@pytest.mark.parametrize("first", [0, 3])
@pytest.mark.parametrize("has_log_times", [False, True])
def test_rows_of_cut_stamps_and_log_times_are_spread_evenly(first: int, has_log_times: bool) -> None:
    fixes, *others = drive()
    fixes = fixes.select_rows(np.arange(len(fixes)) >= first)
    cut_ns = fixes.stamp_ns // NS * NS
    wrong = replace(fixes, stamp_ns=cut_ns, log_time_ns=cut_ns if has_log_times else None)
    (aligned, *_), (note,) = align_source_clocks_and_note([wrong, *others])
    np.testing.assert_allclose((aligned.stamp_ns - fixes.stamp_ns) / NS, 0.05, atol=0.01)
    assert note == "/position: its stamps are cut to 1 s, and its log times too; the rows of each are spread evenly"


def test_repeated_messages_and_stamps_of_batches_are_not_spread() -> None:
    fixes, *others = drive()
    fixes = replace(fixes, log_time_ns=None)
    twice = replace(fixes, stamp_ns=np.repeat(fixes.stamp_ns, 2), values=np.repeat(fixes.values, 2, axis=0))
    batch_ns = (fixes.stamp_ns // NS * NS + fixes.stamp_ns % 7 * 1_000_003)[np.arange(len(fixes)) // 10 * 10]
    for each in (twice, replace(fixes, stamp_ns=np.sort(batch_ns) + np.arange(len(fixes)) // 10 * 12_345_677)):
        aligned, notes = align_source_clocks_and_note([each, *others])
        assert (aligned[0].stamp_ns == each.stamp_ns).all()
        assert not notes


@pytest.mark.parametrize("is_of_next", [False, True])
def test_rows_with_the_stamp_of_their_neighbour_go_into_the_pause_beside_it(is_of_next: bool) -> None:
    fixes, *others = drive()
    stamp_ns = fixes.stamp_ns.copy()
    rows = np.arange(10, len(fixes) - 10, 7)
    stamp_ns[rows] = fixes.stamp_ns[rows + (1 if is_of_next else -1)]
    (aligned, *unchanged), (note,) = align_source_clocks_and_note([replace(fixes, stamp_ns=stamp_ns), *others])
    np.testing.assert_allclose((aligned.stamp_ns - fixes.stamp_ns) / NS, 0.0, atol=1e-3)
    assert unchanged == others
    assert note.startswith(f"/position: its stamps repeat in {len(rows)} of {len(fixes)} rows with other values")


def test_rows_of_equal_stamp_without_a_pause_stay() -> None:
    fixes, *others = drive()
    twice = replace(fixes, stamp_ns=np.repeat(fixes.stamp_ns, 2)[: len(fixes)], log_time_ns=None)
    several = replace(
        fixes, stamp_ns=np.insert(fixes.stamp_ns, range(0, 1000, 50), fixes.stamp_ns[0:1000:50]),
        values=np.insert(fixes.values, range(0, 1000, 50), fixes.values[0:1000:50] + 0.1, axis=0), log_time_ns=None,
    )  # fmt: skip
    assert not any("stamps repeat" in note for note in align_source_clocks_and_note([several, *others])[1])
    assert not any("stamps repeat" in note for note in align_source_clocks_and_note([twice, *others])[1])
