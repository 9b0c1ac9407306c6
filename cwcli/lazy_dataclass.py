"""`dataclass` of the standard library, whose methods are compiled when they are first needed.

The standard decorator compiles five methods for each class while its module is imported, half a millisecond each time:
a fifth of a short `estimate`. This one gives the class small stand-ins. The first instances are filled by a loop over
the fields; after `MAX_INSTANCES_BEFORE_COMPILATION` of them, or when a method of a data class is used (`==`, `repr`, a
wrong argument), the standard decorator makes the methods, and they take the place of the stand-ins. What `fields` and
`replace` ask for, a description of each field, is made without any method.

`replace` is that of the standard library without its detour through the constructor, which takes ten times as long.
"""

from __future__ import annotations

import re
import sys
import threading
from abc import ABCMeta
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass  # noqa: PLC0414 - they are exported
    from dataclasses import replace as replace  # noqa: PLC0414
else:

    def replace(instance: Any, /, **changes: Any) -> Any:
        """Return a copy of a data class's instance with other values of some fields, as `dataclasses.replace` does."""
        kind = type(instance)
        names = _FIELDS_COPIED_ALONE_BY_REPLACE_BY_CLASS.get(kind)
        if names is None:
            names = _FIELDS_COPIED_ALONE_BY_REPLACE_BY_CLASS[kind] = _names_of_merely_stored_fields(kind)
        if names:
            stored = vars(instance)
            values = {name: stored[name] for name in names}
            values.update(changes)
            if len(values) == len(names):
                copy = object.__new__(kind)
                copy.__dict__.update(values)
                return copy
        from dataclasses import replace as standard

        return standard(instance, **changes)

    def dataclass(cls: type | None = None, /, *, frozen: bool = False, kw_only: bool = False) -> Any:
        """Make a class a data class, as `dataclasses.dataclass` does with these arguments."""
        if cls is None:
            return lambda kind: _defer_class_methods(kind, {"frozen": frozen, "kw_only": kw_only})
        return _defer_class_methods(cls, {})


MAX_INSTANCES_BEFORE_COMPILATION = 64
"""Number of instances of a class that a loop fills before its methods are compiled. Chosen by hand: the loop takes some
microseconds an instance, and compiling as long as a hundred of them."""
_ATTRIBUTES_COPIED_FROM_COMPILED_CLASS = ("__repr__", "__eq__", "__hash__", "__match_args__", "__replace__", "__init__")
"""Methods and attributes that are taken from the compiled class; `__init__` comes last, so that threads see all."""
_ATTRIBUTES_WHOSE_FIRST_USE_COMPILES_CLASS = ("__dataclass_params__", "__match_args__", "__signature__")
"""Class attributes whose first use compiles the class."""
_DATACLASSES_HAVE_REPLACE = sys.version_info >= (3, 13)
"""Whether data classes have a `__replace__`, for `copy.replace` (Python 3.13)."""
_ANNOTATIONS_ARE_LAZY = sys.version_info >= (3, 14)
"""Whether a class's body holds no annotations, but a function that makes them (PEP 649, Python 3.14)."""
_CLASS_VARIABLE_ANNOTATIONS = re.compile(r"(\w+\.)*ClassVar\b")
"""The annotations of what is no field."""
_lock = threading.RLock()
_NO_DEFAULT: Any = object()
"""Marks a field without a default."""
_FIELDS_COPIED_ALONE_BY_REPLACE_BY_CLASS: dict[type, tuple[str, ...]] = {}
"""Data class -> the names of its fields, where `replace` can copy these alone; else nothing."""
_PlainField = tuple[str, Any, Any, bool]
"""Name, default, default factory, and whether the field is an argument by keyword alone."""


def _defer_class_methods(owner: type, settings: dict[str, bool]) -> type:
    """Put off the methods of a class; one that is out of the ordinary gets the standard ones at once."""
    if not _can_defer_methods(owner, frozen=settings.get("frozen", False)):
        from dataclasses import dataclass as standard

        return standard(**settings)(owner)
    return _Deferred(owner, settings).owner


def _can_defer_methods(owner: type, *, frozen: bool) -> bool:
    """Whether nothing but the standard decorator's own checks and methods takes part in making the class."""
    body = vars(owner)
    if _ANNOTATIONS_ARE_LAZY or type(owner) not in (type, ABCMeta) or {"__slots__", "__setattr__"} & body.keys():
        return False
    for base in owner.__mro__[1:-1]:
        if base.__module__ != "typing" and "__init_subclass__" in vars(base):
            return False
        parent = _DEFERRED_METHODS_BY_CLASS.get(base)
        if "__dataclass_fields__" in vars(base) and (parent is None or parent.is_frozen is not frozen):
            return False
    has_default = False
    for name, annotation in body.get("__annotations__", {}).items():
        default = body.get(name, _NO_DEFAULT)
        if isinstance(annotation, str) and _CLASS_VARIABLE_ANNOTATIONS.match(annotation):
            continue
        if default is _NO_DEFAULT and has_default:
            return False
        has_default |= default is not _NO_DEFAULT
        if default is not _NO_DEFAULT and (type(default).__hash__ is None or hasattr(type(default), "__set__")):
            return False
    return True


class _Attribute:
    """A class attribute of a data class that is not there before the class is compiled."""

    def __init__(self, deferred: _Deferred, name: str) -> None:
        self._deferred = deferred
        self._name = name

    def __get__(self, instance: object, owner: type) -> Any:
        self._deferred.compile_methods()
        return getattr(owner, self._name)  # without a `__signature__`, that of `__init__` counts


class _FieldDescriptions:
    """`__dataclass_fields__` of a data class before its first use."""

    def __init__(self, deferred: _Deferred) -> None:
        self._deferred = deferred

    def __get__(self, instance: object, owner: type) -> Any:
        return self._deferred.describe_fields()


class _Deferred:
    """A data class whose methods are not compiled yet.

    Args:
        settings: Arguments of the standard decorator.
    """

    def __init__(self, owner: type, settings: dict[str, bool]) -> None:
        self.owner = owner
        self.n_filled = 0
        self.body = dict(vars(owner))
        self._settings = settings
        self._fields: tuple[_PlainField, ...] | None = None
        self._stand_ins: dict[str, object] = {}
        self._is_compiled = False
        _DEFERRED_METHODS_BY_CLASS[owner] = self
        for name, value in self.body.items():
            if type(value).__name__ == "Field" and type(value).__module__ == "dataclasses":
                if _is_default_stated(value.default):
                    setattr(owner, name, value.default)
                else:
                    delattr(owner, name)
        self._put_stand_ins()

    @property
    def is_frozen(self) -> bool:
        """Whether its instances can't be changed."""
        return self._settings.get("frozen", False)

    def _put_stand_ins(self) -> None:
        own, is_frozen = self.body, self.is_frozen
        methods = {"__init__": _make_init(self), "__repr__": _make_compiling_method(self, "__repr__")}
        methods["__eq__"] = _make_compiling_method(self, "__eq__")
        if _DATACLASSES_HAVE_REPLACE:
            methods["__replace__"] = _make_compiling_method(self, "__replace__")
        if is_frozen and own.get("__hash__") is None and ("__hash__" not in own or "__eq__" in own):
            methods["__hash__"] = _make_compiling_method(self, "__hash__")
            self._set_stand_in("__hash__", methods.pop("__hash__"))
        elif "__hash__" not in own and "__eq__" not in own:
            self._set_stand_in("__hash__", None)
        for name, value in methods.items():
            if name not in own:
                self._set_stand_in(name, value)
        for name in _ATTRIBUTES_WHOSE_FIRST_USE_COMPILES_CLASS:
            self._set_stand_in(name, _Attribute(self, name))
        self._set_stand_in("__dataclass_fields__", _FieldDescriptions(self))
        if is_frozen:
            type.__setattr__(self.owner, "__setattr__", _make_frozen_setattr(self.owner))
            type.__setattr__(self.owner, "__delattr__", _refuse_to_delete(self.owner))

    def _set_stand_in(self, name: str, value: object) -> None:
        self._stand_ins[name] = value
        setattr(self.owner, name, value)

    def compile_methods(self) -> None:
        """Let the standard decorator make the methods of the class."""
        import dataclasses

        with _lock:
            if self._is_compiled:
                return
            owner = self.owner
            body = {key: value for key, value in self.body.items() if key not in ("__dict__", "__weakref__")}
            body |= {"__qualname__": owner.__qualname__, "__annotations__": self._annotations_without_bases()}
            twin: type = dataclasses.dataclass(**self._settings)(type(owner)(owner.__name__, owner.__bases__, body))
            found = vars(twin)
            self._is_compiled = True
            type.__delattr__(owner, "__signature__")
            for name in ("__dataclass_fields__", "__dataclass_params__", *_ATTRIBUTES_COPIED_FROM_COMPILED_CLASS):
                current_method = vars(owner).get(name, _NO_DEFAULT)
                if name in found and (
                    current_method is _NO_DEFAULT or current_method is self._stand_ins.get(name, _NO_DEFAULT)
                ):
                    setattr(owner, name, found[name])

    def describe_fields(self) -> dict[str, Any]:
        """Name -> `dataclasses.Field`, bases first, made by the standard decorator of a class that has nothing else."""
        import dataclasses

        with _lock:
            owner = self.owner
            found: dict[str, Any] | _FieldDescriptions = vars(owner)["__dataclass_fields__"]
            if not isinstance(found, _FieldDescriptions):
                return found
            annotations = self._annotations_without_bases()
            body = {name: self.body[name] for name in annotations if name in self.body}
            body |= {"__annotations__": annotations, "__module__": owner.__module__, "__doc__": "The fields alone."}
            alone: Any = dataclasses.dataclass(
                init=False, repr=False, eq=False, match_args=False, kw_only=self._settings.get("kw_only", False)
            )(type(owner.__name__, (), body))
            fields: dict[str, Any] = {}
            for base in owner.__mro__[-1:0:-1]:
                fields |= getattr(base, "__dataclass_fields__", {})
            fields |= vars(alone)["__dataclass_fields__"]
            type.__setattr__(owner, "__dataclass_fields__", fields)
            return fields

    def instance_fields_for_loop(self) -> tuple[_PlainField, ...] | None:
        """Those of the instance, bases first; None where a loop can't fill them."""
        if self._fields is None:
            fields: dict[str, _PlainField] = {}
            for base in reversed(self.owner.__mro__):
                deferred = _DEFERRED_METHODS_BY_CLASS.get(base)
                own = () if deferred is None else deferred._fields_without_bases()
                if own is None or (deferred is None and "__dataclass_fields__" in vars(base)):
                    return None
                fields.update((field[0], field) for field in own)
            self._fields = tuple(fields.values())
        return self._fields

    def _annotations_without_bases(self) -> dict[str, Any]:
        """Those of the class itself, without its bases'."""
        return dict(vars(self.owner).get("__annotations__", {}))

    def _fields_without_bases(self) -> list[_PlainField] | None:
        found: list[_PlainField] = []
        is_keyword = self._settings.get("kw_only", False)
        for name, annotation in self._annotations_without_bases().items():
            if not isinstance(annotation, str) or "InitVar" in annotation or "KW_ONLY" in annotation:
                return None
            if _CLASS_VARIABLE_ANNOTATIONS.match(annotation):
                continue
            value: Any = self.body.get(name)
            if type(value).__name__ == "Field" and type(value).__module__ == "dataclasses":
                if not value.init:
                    return None
                default, factory = (
                    each if _is_default_stated(each) else _NO_DEFAULT for each in (value.default, value.default_factory)
                )
                found.append((name, default, factory, is_keyword or value.kw_only is True))
            else:
                found.append((name, getattr(self.owner, name, _NO_DEFAULT), _NO_DEFAULT, is_keyword))
        return found


_DEFERRED_METHODS_BY_CLASS: dict[type, _Deferred] = {}
"""Each class of this decorator -> how its methods are made."""


def _is_default_stated(value: object) -> bool:
    """Whether a field's default, or its factory, is one: not the mark of `dataclasses` for none."""
    return type(value).__name__ != "_MISSING_TYPE"


def _names_of_merely_stored_fields(kind: type) -> tuple[str, ...]:
    """Return the names of the fields of a class whose constructor does nothing but store them; else nothing."""
    deferred = _DEFERRED_METHODS_BY_CLASS.get(kind)
    defined_names = {name for base in kind.__mro__ for name in _class_body_without_added_methods(base)}
    if deferred is None or {"__init__", "__new__", "__post_init__"} & defined_names:
        return ()
    return tuple(name for name, *_ in deferred.instance_fields_for_loop() or ())


def _class_body_without_added_methods(kind: type) -> Mapping[str, Any]:
    """Return what the body of a class says: of a data class without the methods that the decorator adds."""
    deferred = _DEFERRED_METHODS_BY_CLASS.get(kind)
    return {} if kind is object else vars(kind) if deferred is None else deferred.body


def _make_init(deferred: _Deferred) -> Any:
    owner: Any = deferred.owner

    def __init__(self: Any, /, *args: Any, **kwargs: Any) -> None:
        deferred.n_filled += 1
        values = (
            None
            if deferred.n_filled > MAX_INSTANCES_BEFORE_COMPILATION
            else _field_values_or_none_if_misfit(deferred.instance_fields_for_loop(), args, kwargs)
        )
        if values is None:
            deferred.compile_methods()
            owner.__init__(self, *args, **kwargs)
            return
        self.__dict__.update(values)
        after = getattr(self, "__post_init__", None)
        if after is not None:
            after()

    return __init__


def _field_values_or_none_if_misfit(
    fields: tuple[_PlainField, ...] | None, args: tuple[Any, ...], kwargs: dict[str, Any]
) -> dict[str, Any] | None:
    """The value of each field by name; None where the arguments do not fit, which the compiled method says."""
    if fields is None or len(args) > len(fields):
        return None
    values: dict[str, Any] = {}
    n_named = 0
    n_placed = 0
    for name, default, factory, is_keyword in fields:
        if n_placed < len(args) and not is_keyword:
            values[name] = args[n_placed]
            n_placed += 1
        elif name in kwargs:
            values[name] = kwargs[name]
            n_named += 1
        elif factory is not _NO_DEFAULT:
            values[name] = factory()
        elif default is not _NO_DEFAULT:
            values[name] = default
        else:
            return None
    return values if n_placed == len(args) and n_named == len(kwargs) else None


def _make_compiling_method(deferred: _Deferred, name: str) -> Any:
    def method(self: Any, *args: Any, **kwargs: Any) -> Any:
        deferred.compile_methods()
        return getattr(deferred.owner, name)(self, *args, **kwargs)

    method.__name__ = name
    return method


def _make_frozen_setattr(owner: Any) -> Any:
    def __setattr__(self: Any, name: str, value: object) -> None:
        if type(self) is owner or name in owner.__dataclass_fields__:
            from dataclasses import FrozenInstanceError

            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        super(owner, self).__setattr__(name, value)

    return __setattr__


def _refuse_to_delete(owner: Any) -> Any:
    def __delattr__(self: Any, name: str) -> None:
        if type(self) is owner or name in owner.__dataclass_fields__:
            from dataclasses import FrozenInstanceError

            raise FrozenInstanceError(f"cannot delete field {name!r}")
        super(owner, self).__delattr__(name)

    return __delattr__
