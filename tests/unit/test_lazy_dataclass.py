"""A lazy data class behaves as the standard one, whatever is used of it first."""

from __future__ import annotations

import ast
import copy
import dataclasses
import importlib
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import pytest

from cwcli import lazy_dataclass

ROOT = Path(__file__).parents[2]
T = TypeVar("T")
Decorator = Callable[..., Any]


def classes(decorator: Decorator) -> dict[str, type[Any]]:
    """The same classes by a decorator."""

    @decorator(frozen=True)
    class Point:
        """A point."""

        unit: ClassVar[str] = "m"
        x: float
        y: float = 2.0
        tags: list[str] = field(default_factory=list)
        note: str = field(default="", compare=False, repr=False)

        @cached_property
        def norm(self) -> float:
            return abs(self.x) + abs(self.y)

    @decorator(frozen=True)
    class Place(Point):
        """A point with a name."""

        x: float = 1.0
        name: str = "here"

        def __post_init__(self) -> None:
            if self.name == "nowhere":
                raise ValueError(self.name)

    @decorator
    class Counter:
        """It changes."""

        n: int = 0

    @decorator(frozen=True, kw_only=True)
    class Named:
        """Its fields are given by keyword only."""

        a: int
        b: int = 2

    @decorator(frozen=True)
    class Both(Named):
        """Only its field `place` can be given by position."""

        place: int = 3
        note: str = field(default="n", kw_only=True)

    @decorator(frozen=True)
    class Box(Generic[T]):  # noqa: PLW1641 - it gets a hash from the decorator
        """Of anything, with its own words and its own equality."""

        content: T

        def __repr__(self) -> str:
            return "a box"

        def __eq__(self, other: object) -> bool:
            return isinstance(other, Box)

    @decorator(frozen=True)
    class Late:
        """Not all of it is an argument."""

        a: int
        twice: int = field(init=False, default=7)

    class Plain(Point):
        """No data class itself."""

    return {kind.__name__: kind for kind in (Point, Place, Counter, Named, Both, Box, Late, Plain)}


def outcome(action: Callable[[dict[str, type[Any]]], Any], decorator: Decorator) -> str:
    """What an action gives or raises."""
    try:
        return str(action(classes(decorator)))
    except Exception as error:
        return f"{type(error).__name__}: {error}"


ACTIONS: dict[str, Callable[[dict[str, type[Any]]], Any]] = {
    "repr": lambda of: repr(of["Point"](1.0)),
    "repr-of-a-subclass": lambda of: repr(of["Place"](name="there")),
    "order-of-values": lambda of: vars(of["Place"](1.0, note="n", name="x")),
    "defaults-are-separate": lambda of: of["Point"](1.0).tags is of["Point"](1.0).tags,
    "equal": lambda of: (of["Point"](1.0) == of["Point"](1.0, note="b"), of["Point"](1.0) == of["Place"](1.0)),
    "not-equal": lambda of: of["Point"](1.0) != of["Point"](2.0),
    "hash": lambda of: hash(of["Named"](a=1)) == hash(of["Named"](a=1)),
    "hash-of-a-list": lambda of: hash(of["Point"](1.0)),
    "hash-of-one-that-changes": lambda of: hash(of["Counter"]()),
    "hash-with-own-equality": lambda of: hash(of["Box"](3)) == hash(of["Box"](3)),
    "own-methods": lambda of: (of["Box"](1) == of["Box"](2), repr(of["Box"](1))),
    "missing": lambda of: of["Point"](),
    "unknown": lambda of: of["Point"](1.0, z=2),
    "twice": lambda of: of["Point"](1.0, x=2),
    "too-many": lambda of: of["Counter"](1, 2),
    "keywords-only": lambda of: of["Named"](1),
    "by-keyword": lambda of: of["Named"](a=1),
    "keywords-behind": lambda of: vars(of["Both"](7, a=1)),
    "keywords-behind-after-fields": lambda of: (dataclasses.fields(of["Both"]), vars(of["Both"](7, a=1, note="m")))[1],
    "keyword-in-place": lambda of: of["Both"](7, 8),
    "keyword-missing": lambda of: of["Both"](7),
    "fields-then-the-rest": lambda of: (
        [(each.name, each.type, each.default, each.kw_only) for each in dataclasses.fields(of["Place"])],
        of["Place"](name="a") == of["Place"](name="a"),
        repr(of["Place"](name="a")),
    ),
    "fields-of-each": lambda of: [
        [(each.name, each.compare, each.repr, each.init, each.kw_only) for each in dataclasses.fields(of[name])]
        for name in sorted(of)
    ],
    "refuses-to-set": lambda of: setattr(of["Point"](1.0), "x", 2),
    "refuses-a-new-one": lambda of: setattr(of["Point"](1.0), "other", 2),
    "refuses-to-delete": lambda of: delattr(of["Point"](1.0), "x"),
    "a-plain-subclass": lambda of: (setattr(of["Plain"](1.0), "z", 2), repr(of["Plain"](1.0, 3.0))),  # type: ignore[func-returns-value]
    "a-plain-subclass-is-frozen": lambda of: setattr(of["Plain"](1.0), "x", 2),
    "changes": lambda of: (counter := of["Counter"](), setattr(counter, "n", 5), counter.n)[2],  # type: ignore[func-returns-value]
    "after-init": lambda of: of["Place"](name="nowhere"),
    "cached": lambda of: of["Point"](3.0).norm,
    "class-attributes": lambda of: (of["Point"].y, of["Point"].note, hasattr(of["Point"], "tags"), of["Point"].unit),
    "fields": lambda of: [each.name for each in dataclasses.fields(of["Place"])],
    "names-of-fields": lambda of: list(of["Place"].__dataclass_fields__),
    "replace": lambda of: dataclasses.replace(of["Place"](name="a"), x=9.0),
    "asdict": lambda of: dataclasses.asdict(of["Point"](1.0)),
    "is-dataclass": lambda of: (dataclasses.is_dataclass(of["Point"]), dataclasses.is_dataclass(of["Counter"]())),
    "signature": lambda of: (inspect.signature(of["Point"]), inspect.signature(of["Place"])),
    "signature-of-a-subclass": lambda of: inspect.signature(of["Plain"]),
    "not-an-argument": lambda of: (of["Late"](1), of["Late"](1, 2)),
    "late": lambda of: of["Late"](1),
    "match": lambda of: of["Point"].__match_args__,
    "params": lambda of: of["Named"].__dataclass_params__,
    "copy": lambda of: copy.copy(of["Point"](1.0)) == of["Point"](1.0),
    "many": lambda of: [of["Point"](float(k)).x for k in range(3 * lazy_dataclass.MAX_INSTANCES_BEFORE_COMPILATION)],
    "bases": lambda of: [kind.__name__ for kind in of["Place"].__mro__],
    "words": lambda of: of["Point"].__doc__,
}


def test_fields_and_replace_compile_no_method() -> None:
    kinds = classes(lazy_dataclass.dataclass)
    stand_in = vars(kinds["Place"])["__init__"]
    assert [each.name for each in dataclasses.fields(kinds["Place"])] == ["x", "y", "tags", "note", "name"]
    assert dataclasses.replace(kinds["Place"](name="a"), x=9.0).x == 9.0
    assert vars(kinds["Place"])["__init__"] is stand_in


@pytest.mark.parametrize("name", ACTIONS)
def test_it_does_what_the_standard_one_does(name: str) -> None:
    expected = outcome(ACTIONS[name], dataclasses.dataclass)
    assert outcome(ACTIONS[name], lazy_dataclass.dataclass) == expected


CHANGES: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "one": ("Point", {"x": 1.0}, {"y": 3.0}),
    "none": ("Point", {"x": 1.0, "note": "n"}, {}),
    "unknown": ("Point", {"x": 1.0}, {"z": 3.0}),
    "of-a-subclass": ("Place", {"name": "a"}, {"x": 9.0}),
    "refused-after-init": ("Place", {"name": "a"}, {"name": "nowhere"}),
    "one-that-changes": ("Counter", {}, {"n": 4}),
    "keywords-only": ("Both", {"a": 1, "place": 7}, {"note": "m"}),
    "no-argument": ("Late", {"a": 1}, {"twice": 3}),
    "plain-subclass": ("Plain", {"x": 1.0}, {"y": 3.0}),
}
"""Class, its values and the changes of a copy."""


@pytest.mark.parametrize("name", CHANGES)
def test_replace_does_what_the_standard_one_does(name: str) -> None:
    kind, values, changes = CHANGES[name]

    def copy_with(replace: Callable[..., Any]) -> Callable[[dict[str, type[Any]]], Any]:
        return lambda of: (copied := replace(of[kind](**values), **changes), type(copied).__name__, vars(copied))[1:]

    expected = outcome(copy_with(dataclasses.replace), dataclasses.dataclass)
    assert outcome(copy_with(lazy_dataclass.replace), lazy_dataclass.dataclass) == expected


def test_replace_copies_no_cached_value() -> None:
    point = classes(lazy_dataclass.dataclass)["Point"](3.0)
    assert point.norm == 5.0
    assert lazy_dataclass.replace(point, x=1.0).norm == 3.0


@lazy_dataclass.dataclass(frozen=True)
class Sent:
    """For the pickle."""

    a: int
    b: tuple[int, ...] = ()


def test_one_that_was_unpickled_before_any_was_made_is_equal_and_frozen() -> None:
    code = f"import pickle; x = pickle.loads({pickle.dumps(Sent(1, (2,)))!r}); print(x); x.a = 3"
    done = subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "Sent(a=1, b=(2,))\n"
    assert "FrozenInstanceError: cannot assign to field 'a'" in done.stderr


def test_threads_that_compile_a_class_at_once_all_make_instances() -> None:
    for _ in range(20):
        kind = classes(lazy_dataclass.dataclass)["Point"]
        with ThreadPoolExecutor(8) as pool:
            made = list(
                pool.map(
                    lambda k, kind=kind: kind(float(k)), range(8 * lazy_dataclass.MAX_INSTANCES_BEFORE_COMPILATION)
                )
            )
        assert [point.x for point in made] == [float(k) for k in range(len(made))]


def test_the_first_instances_compile_nothing() -> None:
    kind = classes(lazy_dataclass.dataclass)["Place"]
    for _ in range(lazy_dataclass.MAX_INSTANCES_BEFORE_COMPILATION):
        kind()
    assert "Place.__init__" not in kind.__init__.__qualname__
    kind()
    assert kind.__init__.__qualname__.endswith("Place.__init__")


def test_frozen_ones_refuse_before_and_after() -> None:
    sent = Sent(1)
    for _ in range(2):
        with pytest.raises(FrozenInstanceError):
            sent.a = 2  # type: ignore[misc]
        assert sent == Sent(1)


def test_every_class_of_cwcli_can_be_compiled() -> None:
    """A wrong field, such as a list as default, is otherwise found at the first use of its class."""
    decorated = 0
    for path in sorted((ROOT / "cwcli").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        standard = [
            node
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module == "dataclasses" and path.name != "lazy_dataclass.py"
        ]
        names = {alias.name for node in standard for alias in node.names}
        assert "dataclass" not in names, f"{path}: from cwcli.lazy_dataclass import dataclass"
        decorated += any(isinstance(n, ast.ImportFrom) and n.module == "cwcli.lazy_dataclass" for n in ast.walk(tree))
        if path.name not in {"__main__.py", "warm.py"}:
            importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"))
    assert decorated > 250
    for kind in list(lazy_dataclass._DEFERRED_METHODS_BY_CLASS):
        dataclasses.fields(kind)


def keyword_base(decorator: Decorator) -> object:
    """A base whose fields are keywords: those of the class itself come first."""

    @decorator(kw_only=True)
    class Base:
        a: int = 1

    @decorator(frozen=False)
    class Child(Base):
        b: int = 2

    child: Any = Child
    return child(5).b


def mutable_default(decorator: Decorator) -> object:
    """A default that all instances would share."""

    @decorator(frozen=True)
    class Shared:
        values: list[int] = []  # noqa: RUF012 - what is refused

    return Shared().values


def default_before_none(decorator: Decorator) -> object:
    """A field without a default after one with it."""

    @decorator(frozen=True)
    class Late:
        a: int = 1
        b: int

    late: Any = Late
    return late(1, 2)


def frozen_child(decorator: Decorator) -> object:
    """A frozen class of one that is not."""

    @decorator(frozen=False)
    class Base:
        a: int = 1

    @decorator(frozen=True)
    class Child(Base):
        b: int = 2

    return Child().b


def counted_subclasses(decorator: Decorator) -> object:
    """A base that counts its subclasses."""
    found: list[str] = []

    class Base:
        def __init_subclass__(cls) -> None:
            found.append(cls.__name__)

    @decorator(frozen=True)
    class Child(Base):
        a: int = 1

    assert repr(Child()).endswith("Child(a=1)")
    return found


def own_setter(decorator: Decorator) -> object:
    """A class that notes what is set."""
    found: list[str] = []

    @decorator(frozen=False)
    class Noting:
        a: int = 1

        def __setattr__(self, name: str, value: object) -> None:
            found.append(name)
            object.__setattr__(self, name, value)

    Noting()
    return found


def patched_repr(decorator: Decorator) -> object:
    """A method that is replaced after the class is made stays replaced."""

    @decorator(frozen=True)
    class Patched:
        a: int = 1

    Patched.__repr__ = lambda self: "mine"  # type: ignore[method-assign]
    assert Patched() == Patched()
    return repr(Patched())


ODD = (keyword_base, mutable_default, default_before_none, frozen_child, counted_subclasses, own_setter, patched_repr)


@pytest.mark.parametrize("case", ODD)
def test_odd_class_is_as_by_the_standard_decorator(case: Callable[[Decorator], object]) -> None:
    def outcome(decorator: Decorator) -> object:
        try:
            return case(decorator)
        except (TypeError, ValueError) as error:
            return type(error)

    assert outcome(lazy_dataclass.dataclass) == outcome(dataclasses.dataclass)
