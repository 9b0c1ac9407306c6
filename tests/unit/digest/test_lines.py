"""The layout of a digest: twelve lines of 80 cells, whatever the sentences are."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cwcli.digest.lines import LABEL_WIDTH_CELLS, Block, format_blocks, shorten_path, trust_or_doubt_block
from cwcli.evaluation.doubts.base import Doubt
from cwcli.text import terminal_cells_of_text


def doubt(name: str, sentence: str) -> Doubt:
    return Doubt(name, sentence, "Check it.", 2.0, 1.0, "")


def test_blocks_stand_behind_their_labels() -> None:
    lines = format_blocks([Block("what", ("It rained.",)), Block("made", ()), Block("next", ("go home",))])
    assert lines == ["what   It rained.", "next   go home"]


def test_lines_are_wrapped_behind_the_label() -> None:
    assert format_blocks([Block("what", ("one two three four five",))], width=24) == [
        "what   one two three",
        "       four five",
    ]


def test_whole_sentences_that_do_not_fit_are_left_out() -> None:
    block = Block("what", ("one two three four.", "five six seven eight."))
    assert format_blocks([block], width=27, max_lines=2) == ["what   one two three four."]


def test_first_sentence_is_cut_if_it_alone_does_not_fit() -> None:
    lines = format_blocks([Block("what", ("word " * 100,))], max_lines=2)
    assert len(lines) == 2
    assert lines[-1].endswith("...")


def test_lines_go_first_to_what_each_block_needs_at_least() -> None:
    long = Block("what", tuple(f"Sentence {k} of a long story." for k in range(60)))
    lines = format_blocks([long, Block("doubt", ("word " * 40,), 3), Block("next", ("go home",))])
    labels = [line[:LABEL_WIDTH_CELLS].strip() for line in lines]
    assert len(lines) == 12
    assert labels.index("doubt") == 8
    assert labels.index("next") == 11


def test_block_that_may_be_left_out_gets_whole_sentences_or_nothing() -> None:
    first = Block("what", ("one two three four five",))
    also = Block("also", ("six seven eight nine ten",), 0)
    assert format_blocks([first, also], width=24, max_lines=3) == ["what   one two three", "       four five"]
    assert format_blocks([first, also], width=24, max_lines=4)[2:] == ["also   six seven eight", "       nine ten"]


@pytest.mark.parametrize("sentence", ["x" * 5000, "日本" * 300, "\x1b[2J\n" * 90, "a " * 3000, "", "é\u0301" * 400])
@pytest.mark.parametrize("width", [1, 24, 80, 500])
def test_no_line_is_wider_than_the_terminal_and_none_is_forged(sentence: str, width: int) -> None:
    blocks = [Block("what", (sentence, sentence), 4), Block("doubt", (sentence,), 4), Block("made", (sentence,))]
    lines = format_blocks(blocks, width=width)
    assert len(lines) <= 12
    assert all(terminal_cells_of_text(line) <= min(max(width, 24), 80) for line in lines)
    assert all(line.isprintable() or line == "" for line in lines)


def test_worst_doubt_is_said_and_the_others_are_named() -> None:
    block = trust_or_doubt_block(
        [doubt("fixes", "The track lies."), doubt("late", "X."), doubt("late", "Y.")], ("no truth",)
    )
    assert block.label == "doubt"
    assert block.sentences == (
        "Do not trust this as it is: the track lies.",
        "Check it.",
        "2 more doubts: late states.",
    )


def test_corrected_sensor_is_checked_and_not_distrusted() -> None:
    corrected = replace(doubt("correction", "The speed is in km/h: converted."), is_repaired=True)
    block = trust_or_doubt_block([corrected], ())
    assert block.label == "check"
    assert block.sentences[0] == "A wrong sensor was corrected: the speed is in km/h: converted."
    assert trust_or_doubt_block([corrected, doubt("fixes", "The track lies.")], ()).label == "doubt"


def test_without_a_doubt_the_errors_are_said() -> None:
    block = trust_or_doubt_block([], ("It errs by 1 m.",))
    assert (block.label, block.sentences) == ("trust", ("No reason for doubt was found.", "It errs by 1 m."))


def test_path_keeps_the_name_of_the_file() -> None:
    assert shorten_path("a/b.mcap", 20) == "a/b.mcap"
    assert shorten_path("/a/very/long/way/to/drive.mcap", 15) == "...o/drive.mcap"
    assert terminal_cells_of_text(shorten_path("日" * 50, 21)) <= 21
