"""What cwcli knows of a stage before its code is imported: one line of `cwcli.stages.STAGES`."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from cwcli.channels.published import PUBLISHED
from cwcli.errors import UsageError


@dataclass(frozen=True)
class Stage:
    """A stage. The command line, `info`, `run`, the fleet and the docs are made from this.

    Attributes:
        name: Its command, its table in a configuration file, and the name of its record.
        help: One line.
        required: Roles without which it can't run.
        one_of: Groups of roles: of each group one must be there.
        used: It uses these roles when they are there.
        instead_of: The stage of which this is another way, "" for none. It runs when it is asked for by name, and
            `cwcli info` lists it for the logs on which it can run.
        on_request: `cwcli run` runs it only when it is asked for by name.
        first: Stage -> values of its options: what its own command runs first on a log that lacks the channels.
        evaluation: Module that judges what the stage made, "" for none (see `cwcli.pipeline.call`).
        package: Where its module is. That holds the function and its configuration, named like the stage
            (`warn_lane`, `WarnLaneConfig`), and `EXAMPLES`.
    """

    name: str
    help: str
    required: tuple[str, ...] = ()
    one_of: tuple[tuple[str, ...], ...] = ()
    used: tuple[str, ...] = ()
    instead_of: str = ""
    on_request: bool = False
    first: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    evaluation: str = ""
    package: str = "cwcli.stages"

    @property
    def identifier(self) -> str:
        """The name as Python spells it."""
        return self.name.replace("-", "_")

    @property
    def added(self) -> dict[str, str]:
        """Role that it adds -> role of the input that it takes."""
        return {each.role: each.source for each in PUBLISHED if each.stage == self.name and each.role}

    @property
    def is_default(self) -> bool:
        """Whether `cwcli run` runs it without being asked."""
        return not self.instead_of and not self.on_request

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Of each of these groups one role must be there."""
        return (*((role,) for role in self.required), *self.one_of)

    @property
    def module(self) -> ModuleType:
        """Its module, imported.

        Raises:
            UsageError: There is none: the installation is broken, or something is missing from it.
        """
        return _imported(f"{self.package}.{self.identifier}", self.name)

    @property
    def function(self) -> Callable[..., Any]:
        """(log, configuration) -> `StageResult`."""
        function: Callable[..., Any] = getattr(self.module, self.identifier)
        return function

    @property
    def configuration(self) -> type[Any]:
        """The class of its configuration."""
        camel = "".join(part.capitalize() for part in self.name.split("-"))
        kind: type[Any] = getattr(self.module, f"{camel}Config")
        return kind

    @property
    def evaluator(self) -> ModuleType | None:
        """The module that judges it."""
        return _imported(self.evaluation, self.name) if self.evaluation else None

    def met_by(self, roles: Collection[str]) -> bool:
        """Whether these roles are enough."""
        return all(any(role in roles for role in group) for group in self.groups)


def _imported(module: str, stage: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise UsageError(
            f"the stage {stage} can't be loaded: there is no module {error.name}", hint="install cwcli again"
        ) from error
