"""The lines of a digest: at most twelve, of at most 80 columns, each block behind its label."""

from __future__ import annotations

from collections.abc import Sequence

from cwcli.evaluation.doubts import DOUBT_RULES
from cwcli.evaluation.doubts.base import Doubt
from cwcli.lazy_dataclass import dataclass
from cwcli.text import escape_control_characters, format_count, shorten_and_escape, terminal_cells_of_text, wrap_text

MAX_DIGEST_LINES = 12
"""Greatest number of lines of a digest; chosen: they fit the smallest terminal and ten seconds of reading."""
MAX_LINE_WIDTH_CELLS = 80
"""Greatest width of a line in cells of the terminal; chosen: the usual width of a terminal."""
LABEL_WIDTH_CELLS = 7
"""Width of the labels in cells: the longest, `doubt`, and two spaces."""
MIN_LINE_WIDTH_CELLS = 24
"""Least width that is used, in cells; chosen by hand: the labels and a word."""
MAX_SENTENCE_CHARACTERS = 600
"""Longest part of a sentence that is laid out, in characters; chosen: more than twelve lines hold of one block."""
NO_DOUBT_TEXT = "No reason for doubt was found."
"""The first sentence on results without a doubt."""
CUT_SENTENCE_MARK = "..."
"""Marks a sentence that was cut."""


@dataclass(frozen=True)
class Block:
    """Sentences behind a label.

    Attributes:
        label: One word; "" for none.
        sentences: In order of importance: the last ones are left out where there is no room.
        least_lines: Lines that the block gets at least, if it needs them; 0: it is left out where no whole sentence
            fits.
    """

    label: str
    sentences: tuple[str, ...]
    least_lines: int = 1


def trust_or_doubt_block(doubts: Sequence[Doubt], confidence: Sequence[str]) -> Block:
    """Return the block that says how far to trust a result: the doubts, or what is known of its errors."""
    if not doubts:
        return Block("trust", (NO_DOUBT_TEXT, *confidence), 3)
    sentences = [doubts[0].headline, doubts[0].advice]
    if len(doubts) > 1:
        names = list(dict.fromkeys(_short_doubt_name(each.name) for each in doubts[1:]))
        sentences.append(f"{format_count(len(doubts) - 1, 'more doubt')}: {', '.join(names)}.")
    label = "check" if all(each.is_repaired for each in doubts) else "doubt"
    return Block(label, tuple(sentences), 4)


def _short_doubt_name(name: str) -> str:
    """Return what a list of doubts calls one."""
    rule = DOUBT_RULES.get(name)
    return (rule.short_name if rule is not None else "") or name.replace("-", " ")


def format_blocks(
    blocks: Sequence[Block], *, width: int = MAX_LINE_WIDTH_CELLS, max_lines: int = MAX_DIGEST_LINES
) -> list[str]:
    """Format blocks as lines; a block gets the lines that it needs, and shares what is missing with the others.

    Args:
        blocks: In order; those without a sentence are left out.
        width: Width of the terminal in cells.
        max_lines: Greatest number of lines together.
    """
    width = max(min(width, MAX_LINE_WIDTH_CELLS), MIN_LINE_WIDTH_CELLS)
    shown = [block for block in blocks if block.sentences]
    wrapped = [_wrap_sentences(block.sentences, width - LABEL_WIDTH_CELLS) for block in shown]
    needed = [lines[-1] if lines else 0 for lines in ([count for _, count in each] for each in wrapped)]
    lines_by_block = [min(need, block.least_lines) for need, block in zip(needed, shown, strict=True)]
    spare = max_lines - sum(lines_by_block)
    for k, need in enumerate(needed):
        more = max(0, min(need - lines_by_block[k], spare))
        lines_by_block[k] += more
        spare -= more
    out: list[str] = []
    for block, most, sentences in zip(shown, lines_by_block, wrapped, strict=True):
        if not block.least_lines and most < sentences[0][1]:
            continue
        lines = _fit_sentences(block.sentences, width - LABEL_WIDTH_CELLS, most)
        out += [f"{block.label if k == 0 else '':{LABEL_WIDTH_CELLS}}{line}" for k, line in enumerate(lines)]
    return out


def _wrap_sentences(sentences: Sequence[str], width: int) -> list[tuple[str, int]]:
    """Return, for each sentence, the text up to it and how many lines that takes."""
    found, text = [], ""
    for sentence in sentences:
        text = f"{text} {shorten_and_escape(sentence, MAX_SENTENCE_CHARACTERS)}".strip()
        found.append((text, len(wrap_text(text, width))))
    return found


def _fit_sentences(sentences: Sequence[str], width: int, max_lines: int) -> list[str]:
    """Return the lines of as many whole sentences as fit; the first one is cut if it alone does not."""
    fitting = [text for text, count in _wrap_sentences(sentences, width) if count <= max_lines]
    if fitting:
        return wrap_text(fitting[-1], width)
    lines = wrap_text(shorten_and_escape(sentences[0], MAX_SENTENCE_CHARACTERS), width)[:max_lines]
    while terminal_cells_of_text(lines[-1]) + len(CUT_SENTENCE_MARK) > width:
        lines[-1] = lines[-1][:-1]
    return [*lines[:-1], f"{lines[-1].rstrip()}{CUT_SENTENCE_MARK}"]


def shorten_path(path: str, width: int) -> str:
    """Return a path that fits into `width` cells: its end is kept, which names the file."""
    shown = escape_control_characters(path)
    while terminal_cells_of_text(shown) > width:
        shown = (
            f"{CUT_SENTENCE_MARK}{shown[len(CUT_SENTENCE_MARK) + 1 :]}"
            if shown.startswith(CUT_SENTENCE_MARK)
            else f"{CUT_SENTENCE_MARK}{shown[1:]}"
        )
    return shown
