"""Typer's names for the modules of commands, without Typer, whose import takes as long as all else that `info` does.

`Option` and `Argument` record what they are given; `to_typer` makes Typer's own of it where Typer is needed: for help,
completion, environment variables, configuration files, and whatever `cwcli.cli.plain_arguments` does not take. Every
other name is Typer's, imported when it is first used.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin

if TYPE_CHECKING:
    from typer import Argument, BadParameter, Context, Option, TyperException

    __all__ = ["Argument", "BadParameter", "Context", "Option", "TyperException"]
else:

    def Option(*flags: str, **settings: Any) -> Declaration:
        """Record an option."""
        return Declaration("Option", flags, settings)

    def Argument(**settings: Any) -> Declaration:
        """Record an argument."""
        return Declaration("Argument", (), settings)

    def __getattr__(name: str) -> Any:
        if name.startswith("__"):  # the import system asks for `__path__`
            raise AttributeError(name)
        import typer

        return getattr(typer, name)


class Declaration:
    """What Typer's `Option` or `Argument` is to be given.

    Attributes:
        kind: `Option` or `Argument`.
        flags: Of the option, each with its negative behind a slash.
        settings: Keyword arguments, or a function that returns them, which is called only where Typer is needed.
    """

    __slots__ = ("flags", "kind", "settings")

    def __init__(
        self, kind: str, flags: tuple[str, ...], settings: Mapping[str, Any] | Callable[[], Mapping[str, Any]]
    ) -> None:
        self.kind = kind
        self.flags = flags
        self.settings = settings

    @property
    def settings_or_empty_if_deferred(self) -> Mapping[str, Any]:
        """The keyword arguments; of those that a function returns, none."""
        return {} if callable(self.settings) else self.settings

    def change(self, *, flags: tuple[str, ...] | None = None, **more: Any) -> Declaration:
        """The same with other flags or further settings."""
        settings = self.settings
        changed = (lambda: {**settings(), **more}) if callable(settings) else {**settings, **more}
        return Declaration(self.kind, self.flags if flags is None else flags, changed)

    def to_typer(self) -> Any:
        """Typer's own."""
        import typer

        settings = self.settings() if callable(self.settings) else self.settings
        return getattr(typer, self.kind)(*self.flags, **settings)


def find_declaration_in_type_hint(annotation: Any) -> Declaration | None:
    """The declaration in a type hint; None if there is none."""
    extras = get_args(annotation)[1:] if get_origin(annotation) is Annotated else ()
    return next((extra for extra in extras if isinstance(extra, Declaration)), None)


def change_declaration(annotation: Any, change: Callable[[Declaration], Declaration]) -> Any:
    """The type hint with its declaration changed."""
    if get_origin(annotation) is not Annotated:
        return annotation
    kind, *extras = get_args(annotation)
    return Annotated[(kind, *(change(extra) if isinstance(extra, Declaration) else extra for extra in extras))]


def use_typer_declarations(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give the signature of a command's function Typer's own declarations; returns the function."""

    def parameter_for_typer(parameter: inspect.Parameter) -> inspect.Parameter:
        return parameter.replace(annotation=change_declaration(parameter.annotation, Declaration.to_typer))

    parameters = [parameter_for_typer(parameter) for parameter in inspect.signature(function).parameters.values()]
    function.__dict__["__signature__"] = inspect.Signature(parameters)
    function.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return function
