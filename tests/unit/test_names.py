"""Names and explanations that a stranger understands: no bare participles or prepositions, no fragments.

A function is called by a verb phrase or by the noun of what it returns (`docs/glossary.md` has the words of the field).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "cwcli"
FIELD_WORDS = {
    "gated",
    "seed",
    "speed",
    "embed",
    "feed",
    "need",
    "read",
    "exceed",
    "proceed",
    "zeroed",
    "unread",
    "shed",
}
"""Words that end like a participle and are nouns, verbs or terms of the field."""
IRREGULAR_PARTICIPLES = {
    "bent", "bound", "built", "chosen", "cut", "dealt", "done", "drawn", "driven", "fallen", "felt", "found",
    "given", "gone", "heard", "held", "hidden", "kept", "known", "laid", "led", "left", "lost", "made", "meant",
    "met", "overridden", "put", "ridden", "said", "seen", "sent", "set", "shown", "spent", "split", "spread",
    "stood", "swept", "taken", "thought", "told", "understood", "won", "worn", "written",
}  # fmt: skip
PREPOSITIONS = {
    "about", "above", "across", "after", "against", "ahead", "along", "among", "apart", "around", "as", "aside",
    "at", "away", "before", "behind", "below", "beside", "besides", "between", "beyond", "by", "down", "for",
    "from", "in", "inside", "into", "like", "near", "of", "off", "on", "onto", "or", "out", "outside", "over",
    "past", "since", "so", "than", "through", "to", "toward", "under", "until", "up", "upon", "with", "within",
    "without",
}  # fmt: skip
VERBS_AMONG_THEM = {"cut", "put", "set", "split", "spread", "bound"}
"""Irregular participles that are imperatives, too."""
WORDS_THAT_NAME_NOTHING = {
    "apart", "asked", "away", "bent", "beside", "heard", "here", "kept", "learned", "lost", "made", "meant", "stands",
    "taken", "there", "told",
}  # fmt: skip
"""Words that were names of variables once and had to be explained."""
FRAGMENT_STARTS = (
    "Of ", "Likewise", "By ", "Beside ", "Over ", "So ", "As ", "In ", "From ", "With ", "At ", "To ", "Where ",
    "When ", "What ", "Whether it", "That ", "Because ", "Nothing ", "For ",
)  # fmt: skip
"""Beginnings of explanations that are no sentences. They are refused for constants."""


def functions(path: Path) -> Iterator[str]:
    """The names of all functions and methods of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name


def variables(path: Path) -> Iterator[str]:
    """The names of all parameters and of all variables that a file assigns."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def is_bare(name: str) -> bool:
    """Whether a name is nothing but a participle or a preposition."""
    word = name.strip("_")
    if "_" in word or name.startswith("__"):
        return False
    is_participle = (
        word.endswith("ed") and word not in FIELD_WORDS
    ) or word in IRREGULAR_PARTICIPLES - VERBS_AMONG_THEM
    return is_participle or word in PREPOSITIONS


def explained_constants(path: Path) -> Iterator[tuple[str, str]]:
    """Name and explanation of each module constant that has one."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    for statement, after in pairwise(body):
        if (
            isinstance(statement, ast.Assign | ast.AnnAssign)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
            and isinstance(after.value.value, str)
        ):
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            yield ast.unparse(target), after.value.value


def is_fragment(text: str) -> bool:
    """Whether an explanation is no sentence: a beginning without a subject, three words or fewer, or no full stop."""
    first = text.split("\n\n", maxsplit=1)[0].strip()
    return first.startswith(FRAGMENT_STARTS) or len(first.split()) <= 3 or not first.endswith((".", ":", ")", "`"))


@pytest.mark.parametrize("name", ["kept", "_settled", "beside", "of", "at", "told", "made"])
def test_a_bare_participle_or_preposition_is_recognised(name: str) -> None:
    assert is_bare(name)


@pytest.mark.parametrize("name", ["gated", "speed_mps", "keep_lane", "split", "read", "__set__", "count_rejected"])
def test_a_verb_or_a_noun_is_no_bare_participle(name: str) -> None:
    assert not is_bare(name)


def test_no_function_is_called_by_a_bare_participle_or_preposition() -> None:
    found = {
        f"{path.relative_to(PACKAGE)}: {name}"
        for path in PACKAGE.rglob("*.py")
        for name in functions(path)
        if is_bare(name)
    }
    assert found == set()


@pytest.mark.parametrize(
    "text", ["Of a joint against a stripe.", "Likewise.", "Where it stands.", "no full stop here at all"]
)
def test_a_fragment_is_recognised(text: str) -> None:
    assert is_fragment(text)


def test_no_local_variable_is_called_by_a_word_that_names_nothing() -> None:
    found = {
        f"{path.relative_to(PACKAGE)}: {name}"
        for path in PACKAGE.rglob("*.py")
        for name in variables(path)
        if name in WORDS_THAT_NAME_NOTHING
    }
    assert found == set()


def test_constants_are_explained_in_sentences() -> None:
    found = {
        f"{path.relative_to(PACKAGE)}: {name}: {text.splitlines()[0]}"
        for path in PACKAGE.rglob("*.py")
        for name, text in explained_constants(path)
        if is_fragment(text)
    }
    assert found == set()
