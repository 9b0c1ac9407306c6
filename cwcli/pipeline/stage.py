"""What cwcli knows of a stage before its code is imported: one line of `cwcli.stages.STAGES`."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection
from types import ModuleType
from typing import Any

from cwcli.channels.published import PUBLISHED_CHANNELS
from cwcli.errors import UsageError
from cwcli.lazy_dataclass import dataclass


@dataclass(frozen=True)
class Stage:
    """The description of a stage, from which the command line, `info`, `run`, the fleet and the docs are generated.

    Attributes:
        name: Its command, its table in a configuration file, and the name of its record.
        help: One line.
        required: Roles that the stage needs.
        one_of: Groups of roles; the stage needs one of each group.
        used: Roles that the stage uses if the log has them.
        instead_of: The stage that this one is an alternative to, "" for none. It runs only if named by the user;
            `cwcli info` lists it for the logs on which it can run.
        on_request: `cwcli run` runs it only if the user names it.
        first: The stages that its command runs first, with their default options, on a log without their channels.
        evaluation: Module that evaluates the stage's result, "" for none (see `cwcli.pipeline.call`).
        package: Package of its module, which holds the function and its configuration, named like the stage
            (`warn_lane`, `WarnLaneConfig`), and `EXAMPLES`.
    """

    name: str
    help: str
    required: tuple[str, ...] = ()
    one_of: tuple[tuple[str, ...], ...] = ()
    used: tuple[str, ...] = ()
    instead_of: str = ""
    on_request: bool = False
    first: tuple[str, ...] = ()
    evaluation: str = ""
    package: str = "cwcli.stages"

    @property
    def python_name(self) -> str:
        """The name with underscores instead of hyphens."""
        return self.name.replace("-", "_")

    @property
    def input_role_by_added_role(self) -> dict[str, str]:
        """Role of each channel that it publishes -> role of the input channel that this is computed from."""
        return {each.role: each.source for each in PUBLISHED_CHANNELS if each.stage == self.name and each.role}

    @property
    def is_default(self) -> bool:
        """Whether `cwcli run` runs it without `--stage`."""
        return not self.instead_of and not self.on_request

    @property
    def required_role_groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups of alternative roles; the stage needs one of each group."""
        return (*((role,) for role in self.required), *self.one_of)

    @property
    def imported_module(self) -> ModuleType:
        """Its module, imported.

        Raises:
            UsageError: It can't be imported, because the installation is broken or incomplete.
        """
        return import_named_module(f"{self.package}.{self.python_name}", f"the stage {self.name}")

    @property
    def stage_function(self) -> Callable[..., Any]:
        """The function of the stage: (log, configuration) -> `StageResult`."""
        function: Callable[..., Any] = self._module_attribute(self.python_name)
        return function

    @property
    def configuration_class(self) -> type[Any]:
        kind: type[Any] = self._module_attribute(f"{''.join(part.capitalize() for part in self.name.split('-'))}Config")
        return kind

    @property
    def examples(self) -> tuple[str, ...]:
        """Command lines for its help."""
        examples: tuple[str, ...] = self._module_attribute("EXAMPLES")
        return examples

    @property
    def evaluation_module(self) -> ModuleType | None:
        """The module that evaluates its result, imported; None without one."""
        return import_named_module(self.evaluation, f"the stage {self.name}") if self.evaluation else None

    def _module_attribute(self, attribute: str) -> Any:
        """Return an attribute of the stage's module.

        Raises:
            UsageError: The module, or the attribute, does not exist.
        """
        module = self.imported_module
        try:
            return getattr(module, attribute)
        except AttributeError as error:
            raise _broken_module_error(f"the stage {self.name}", f"{module.__name__} has no {attribute}") from error

    def is_satisfied_by(self, roles: Collection[str]) -> bool:
        """Return whether these roles are all that the stage needs."""
        return all(any(role in roles for role in group) for group in self.required_role_groups)


def import_named_module(module: str, what: str) -> ModuleType:
    """Import a module that a table names.

    Args:
        what: The thing that it implements, in words for the error.

    Raises:
        UsageError: The module, or one that it imports, does not exist: the installation is broken.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise _broken_module_error(what, f"there is no module {error.name}") from error


def _broken_module_error(what: str, problem: str) -> UsageError:
    return UsageError(f"{what} can't be loaded: {problem}", hint="install cwcli again")
