"""What there are several of: built-in entries from a literal table, more from the entry points of other packages.

A package adds an entry by an entry point in the registry's group, `name = "module:attribute"`. Entries are imported
when they are asked for; names alone take no import. What a plug-in does wrong, when it is imported or when it is
called, is a `PluginError` that names its package.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, replace
from functools import lru_cache, wraps
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

from cwcli.errors import CwcliError, PluginError, Terminated, UsageError, hint_at_closest_or_all_known_names

T = TypeVar("T")
"""The type of a registry's entries."""
MAX_ENTRY_POINTS_BYTES = 1 << 20
"""Greatest part of an `entry_points.txt` that is read, 1 MiB; chosen by hand."""
MAX_ERROR_CHARS_SHOWN = 300
"""Greatest number of characters of a plug-in's error that are shown; chosen by hand."""
VALUE_TYPES_BY_ANNOTATION: dict[str, tuple[type, ...]] = {
    "str": (str,),
    "bool": (bool,),
    "float": (float, int),
    "float | None": (float, int, type(None)),
}
"""Annotation of a data-class field -> the types that its value may have; other annotations are not checked."""
NO_PLUGINS_VARIABLE = "CWCLI_NO_PLUGINS"
"""Environment variable that, set to anything, leaves out the entries of other packages, in worker processes, too."""
_plugins_hidden: ContextVar[bool] = ContextVar("_plugins_hidden", default=False)
"""True while the registries leave out the entries of other packages."""
CheckOfPluginResult = Callable[..., Any]
"""The type of a check: it gets the result of a plug-in's function and the arguments, returns the result, and raises
TypeError or ValueError if the result is wrong."""


class Plugin(NamedTuple):
    """An entry point of another package: `name = target`.

    Attributes:
        package: Name and version of the package.
        what: The kind of thing that it adds, in words.
    """

    name: str
    target: str
    package: str
    what: str = "plug-in"

    def load(self) -> object:
        """Import the object that it names.

        Raises:
            PluginError: It can't be imported.
        """
        with self.report_as_plugin_error("can't be imported"):
            return import_module_attribute(self.target)

    @contextlib.contextmanager
    def report_as_plugin_error(self, problem: str) -> Iterator[None]:
        """Raise whatever the block raises, also what is no `Exception`, as an error of this plug-in.

        A known error of cwcli passes, and so do `KeyboardInterrupt` (but none of its subclasses) and `Terminated`, with
        which the user or the system ends the run.

        Raises:
            PluginError: Something else was raised.
        """
        try:
            yield
        except (CwcliError, Terminated):
            raise
        except BaseException as raised:
            if type(raised) is KeyboardInterrupt:
                raise
            raise self.plugin_error(f"{problem}: {_describe_error_with_place(raised)}") from raised

    def plugin_error(self, problem: str) -> PluginError:
        return PluginError(
            f"the {self.what} '{self.name}' of the package {self.package} {problem}",
            hint=f"it is {self.target}; without it: uninstall {self.package.split()[0]}",
        )


class Registry(Mapping[str, T]):
    """Name -> entry: the built-in ones in the order of the table, then those of plug-ins by name.

    Args:
        what: The word for one entry in messages.
        group: The group of the entry points.
        builtin: Name -> the entry, or `module:attribute` where it is.
        accept: Checks the object that a plug-in's entry point names, and returns it with its functions guarded; see
            `accept_dataclass_of`.
        spell: Entry point's name -> name in the registry.
        reserved_names: Further names that no plug-in may have.
    """

    def __init__(
        self,
        what: str,
        group: str,
        builtin: Mapping[str, T | str],
        accept: Callable[[object, Plugin], T],
        *,
        spell: Callable[[str], str] = str,
        reserved_names: Collection[str] = (),
    ) -> None:
        self.what, self.group = what, group
        self._builtin, self._accept, self._spell, self._reserved_names = builtin, accept, spell, reserved_names
        self._loaded: dict[str | Plugin, T] = {}

    def __getitem__(self, name: str) -> T:
        plugins = self._find_plugins()
        found = plugins[name] if name in plugins else self._builtin[name]
        if not isinstance(found, (str, Plugin)):
            return found
        if found not in self._loaded:
            self._loaded[found] = self._load_entry(found)
        return self._loaded[found]

    def __iter__(self) -> Iterator[str]:
        return iter((*self._builtin, *self._find_plugins()))

    def __len__(self) -> int:
        return len(self._builtin) + len(self._find_plugins())

    def __contains__(self, name: object) -> bool:
        return name in self._builtin or name in self._find_plugins()

    def require(self, name: str) -> T:
        """Return the entry of a name that a user gave.

        Raises:
            UsageError: There is no such entry.
        """
        if name not in self:
            raise UsageError(f"there is no {self.what} '{name}'", hint=hint_at_closest_or_all_known_names(name, self))
        return self[name]

    def describe(self, words: Callable[[T], str] = attrgetter("summary")) -> dict[str, str]:
        """Return name -> words about the entry; for a plug-in that can't be imported, the reason."""
        return {name: self._words_about_entry_or_its_problem(name, words) for name in self}

    def format_help(self) -> str:
        """Return the names with their summaries, for an option's help."""
        return "; ".join(f"{name}: {summary}" for name, summary in self.describe().items()) + "."

    def completions(self, incomplete: str) -> list[tuple[str, str]]:
        """Return the names that begin with `incomplete`, with their summaries, for the shell's completion."""
        return [(name, summary) for name, summary in self.describe().items() if name.startswith(incomplete)]

    def _words_about_entry_or_its_problem(self, name: str, words: Callable[[T], str]) -> str:
        """Return the words about an entry, or why its plug-in can't be used."""
        try:
            return words(self[name])
        except PluginError as error:
            return error.what

    def _load_entry(self, found: str | Plugin) -> T:
        """Import an entry, and check it if it is a plug-in's."""
        if isinstance(found, str):
            entry: T = import_module_attribute(found)
            return entry
        loaded = found.load()
        with found.report_as_plugin_error("can't be used"):
            return self._accept(loaded, found)

    def _find_plugins(self) -> dict[str, Plugin]:
        """Return the plug-ins of the group by name; raise `PluginError` for a name that is taken."""
        out: dict[str, Plugin] = {}
        if _plugins_hidden.get() or NO_PLUGINS_VARIABLE in os.environ:
            return out
        for found in _find_installed_plugins(tuple(sys.path)).get(self.group, ()):
            plugin, name = found._replace(what=self.what), self._spell(found.name)
            if name in self._builtin or name in self._reserved_names:
                raise plugin.plugin_error("has the name of one of cwcli's own")
            if name in out:
                raise plugin.plugin_error(f"has the name of one of the package {out[name].package}")
            out[name] = plugin
        return out


@contextmanager
def hide_plugins() -> Iterator[None]:
    """Leave the entries of other packages out of every registry: for documents about cwcli alone."""
    token = _plugins_hidden.set(True)
    try:
        yield
    finally:
        _plugins_hidden.reset(token)


def import_module_attribute(target: str) -> Any:
    """Import the object that `module:attribute` names."""
    module, _, attribute = target.partition(":")
    return attrgetter(attribute)(importlib.import_module(module))


def accept_dataclass_of(kind: type[T], checks: Mapping[str, CheckOfPluginResult]) -> Callable[[object, Plugin], T]:
    """Return an `accept` for a registry of a data class: it guards each function of an entry and checks the results.

    Args:
        checks: Field with a function -> the check of its results.
    """

    def check_entry(entry: object, plugin: Plugin) -> T:
        if not isinstance(entry, kind):
            raise plugin.plugin_error(f"is no {kind.__name__} but a {type(entry).__name__}")
        for field in fields(entry):  # type: ignore[arg-type]
            value = getattr(entry, field.name)
            if not isinstance(value, VALUE_TYPES_BY_ANNOTATION.get(str(field.type), object)):
                raise plugin.plugin_error(f"has {field.name} = {value!r}, which is no {field.type}")
        functions = {
            field.name: guard_plugin_function(getattr(entry, field.name), field.name, checks.get(field.name), plugin)
            for field in fields(entry)  # type: ignore[arg-type]
            if callable(getattr(entry, field.name))
        }
        return replace(entry, **functions)  # type: ignore[type-var]

    return check_entry


def guard_plugin_function(
    function: Callable[..., Any], name: str, check: CheckOfPluginResult | None, plugin: Plugin
) -> Callable[..., Any]:
    """Return the function of a plug-in so that its errors, and wrong results, are raised as the plug-in's errors."""

    @wraps(function)
    def call_and_check(*arguments: Any, **named_arguments: Any) -> Any:
        with plugin.report_as_plugin_error(f"raised in {name}"):
            result = function(*arguments, **named_arguments)
        if check is None:
            return result
        with plugin.report_as_plugin_error(f"returned from {name} what it must not"):
            try:
                return check(result, *arguments, **named_arguments)
            except (TypeError, ValueError) as wrong:
                raise plugin.plugin_error(f"returned from {name} what it must not: {wrong}") from wrong

    return call_and_check


def _describe_error_with_place(error: BaseException) -> str:
    """Format an error with its place: `ZeroDivisionError: division by zero (rule.py, line 7)`."""
    import traceback
    from pathlib import Path

    ours = (__file__, importlib.__file__, contextlib.__file__)
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename not in ours]
    places = [f" ({Path(frame.filename).name}, line {frame.lineno})" for frame in frames if frame.filename[0] != "<"]
    try:
        text = " ".join(str(error).split())[:MAX_ERROR_CHARS_SHOWN]
    except Exception:  # the plug-in's own exception can't be printed
        text = ""
    return f"{type(error).__name__}{': ' if text else ''}{text}{places[-1] if places else ''}"


@lru_cache(maxsize=8)
def _find_installed_plugins(path: tuple[str, ...]) -> dict[str, list[Plugin]]:
    """Return group -> plug-ins by name, of the packages in the folders of `sys.path`; a package's first copy counts.

    The files are parsed here, because importlib.metadata would take ten times as long at each start.
    """
    out: dict[str, list[Plugin]] = {}
    seen_names: set[str] = set()
    for folder in dict.fromkeys(path):
        try:
            names = sorted(os.listdir(folder or "."))  # noqa: PTH208 - a path for each name would cost more than the rest
        except OSError:
            continue
        for name in names:
            if not name.endswith((".dist-info", ".egg-info")):
                continue
            package, _, version = name.rpartition(".")[0].partition("-")
            known = package.replace("_", "-").replace(".", "-").lower()
            if known not in seen_names:
                seen_names.add(known)
                for group, plugin in _read_entry_points(
                    f"{folder or '.'}/{name}/entry_points.txt", f"{package} {version}"
                ):
                    out.setdefault(group, []).append(plugin)
    return {group: sorted(plugins, key=lambda plugin: plugin.name) for group, plugins in out.items()}


def _read_entry_points(file: str, package: str) -> Iterator[tuple[str, Plugin]]:
    """Yield group and plug-in for each entry point of cwcli's groups in one file."""
    try:
        descriptor = os.open(file, os.O_RDONLY)
    except OSError:
        return
    try:
        text = os.read(descriptor, MAX_ENTRY_POINTS_BYTES)
    finally:
        os.close(descriptor)
    if b"[cwcli." not in text:
        return
    group = ""
    for line in text.decode("utf-8", "replace").splitlines():
        name, separator, target = (part.strip() for part in line.partition("="))
        if line.startswith("["):
            group = line.strip("[] \t")
        elif separator and group.startswith("cwcli.") and not name.startswith(("#", ";")):
            yield group, Plugin(name, target.partition("[")[0].strip(), package.strip())


def bundled_file_stems(package: str, folder: str, suffix: str) -> tuple[str, ...]:
    """Names, without their suffix, of the files in a folder of a package."""
    from importlib.resources import files

    names = (entry.name for entry in (files(package) / folder).iterdir())
    return tuple(sorted(name.removesuffix(suffix) for name in names if name.endswith(suffix)))
