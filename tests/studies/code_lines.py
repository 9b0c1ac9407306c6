"""Code lines of the package, room by room: `python -m tests.studies.code_lines [FOLDER ...]`.

A code line is one that holds a token which is neither a comment nor a docstring. Each folder is a checkout; with two of
them, the second column is the other's.
"""

from __future__ import annotations

import io
import sys
import tokenize
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

SUFFIXES = (".py", ".pyx", ".pxd", ".pyi")
NO_CODE = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
)


def code_lines(text: str) -> int:
    """Lines with code on them. A docstring is a statement that is nothing but a string."""
    lines: set[int] = set()
    for statement in _statements(text):
        if len(statement) == 1 and statement[0].type == tokenize.STRING:
            continue
        for token in statement:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines)


def _statements(text: str) -> list[list[tokenize.TokenInfo]]:
    """Tokens of each logical line. Cython's grammar has Python's tokens."""
    statements: list[list[tokenize.TokenInfo]] = [[]]
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NEWLINE:
            statements.append([])
        elif token.type not in NO_CODE:
            statements[-1].append(token)
    return statements


def by_room(package: Path) -> Counter[str]:
    """Room (folder of the package) -> code lines."""
    rooms: Counter[str] = Counter()
    for path in sorted(package.rglob("*")):
        if path.suffix in SUFFIXES:
            inside = path.relative_to(package).parts
            rooms[inside[0] if len(inside) > 1 else "."] += code_lines(path.read_text(encoding="utf-8"))
    return rooms


def main(folders: Sequence[str]) -> None:
    """Print the table."""
    counts = [by_room(Path(folder) / "cwcli") for folder in folders or (".",)]
    for room in sorted(set().union(*counts)):
        print(f"{room:14}" + "".join(f"{count[room]:8}" for count in counts))
    print(f"{'all':14}" + "".join(f"{count.total():8}" for count in counts))


if __name__ == "__main__":
    main(sys.argv[1:])
