"""cwcli: from a recorded drive to states, predicted paths and collision warnings.

    import cwcli

    log = cwcli.open("drive.mcap")
    result = log.run("estimate", "predict", "warn")
    result.warnings.to_pandas()
    result.save("annotated.mcap")

`__all__` is what is public (docs/python.md). Nothing is imported before it is used, because every start of the command
line imports this module.
"""

from __future__ import annotations

import sys
from types import ModuleType

from cwcli.version import __version__

TYPE_CHECKING = False  # as type checkers take it; importing `typing` would cost more than everything else here
if TYPE_CHECKING:
    from typing import Any

    from mcap.decoder import DecoderFactory

    from cwcli.errors import CwcliError, DataError, InputError, MissingSignalError, OutputError, UsageError
    from cwcli.library.log import Limits, Log
    from cwcli.library.log import open_log as open
    from cwcli.library.pages import write_report as report
    from cwcli.library.result import Result
    from cwcli.library.simulated import write_simulation as simulate

__all__ = [
    "CwcliError",
    "DataError",
    "InputError",
    "Limits",
    "Log",
    "MissingSignalError",
    "OutputError",
    "Result",
    "UsageError",
    "__version__",
    "decoder_factory",
    "open",
    "report",
    "simulate",
]
_MODULE_AND_ATTRIBUTE_BY_PUBLIC_NAME = {
    "CwcliError": "cwcli.errors:CwcliError",
    "DataError": "cwcli.errors:DataError",
    "InputError": "cwcli.errors:InputError",
    "Limits": "cwcli.library.log:Limits",
    "Log": "cwcli.library.log:Log",
    "MissingSignalError": "cwcli.errors:MissingSignalError",
    "OutputError": "cwcli.errors:OutputError",
    "Result": "cwcli.library.result:Result",
    "UsageError": "cwcli.errors:UsageError",
    "open": "cwcli.library.log:open_log",
}
"""Public name -> the module and attribute that it stands for."""
_FUNCTION_BY_NAME_OF_CALLABLE_SUBPACKAGE = {
    "report": "cwcli.library.pages:write_report",
    "simulate": "cwcli.library.simulated:write_simulation",
}
"""Public name that is also that of a room (a package in this one) -> the function that calling it calls."""


def decoder_factory() -> DecoderFactory:
    """Return a factory with which the official MCAP reader decodes every message that cwcli writes.

    Protobuf becomes a message of its class, JSON what `json.loads` returns, CDR (in simulated logs and ROS exports) an
    object with the fields of the ROS message. Recorded channels in these encodings are decoded as well. One factory
    serves any number of files.

        with open("annotated.mcap", "rb") as stream:
            reader = mcap.reader.make_reader(stream, decoder_factories=[cwcli.decoder_factory()])
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                ...

    Raises (while the official reader decodes):
        InputError: A schema can't be used, or a message is damaged.
    """
    from cwcli.logs.codecs.official import OfficialDecoderFactory

    return OfficialDecoderFactory()


def _import_attribute(target: str) -> Any:
    """Import the object that `module:attribute` names."""
    from importlib import import_module

    module, _, attribute = target.partition(":")
    return getattr(import_module(module), attribute)


if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import a public name when it is first used."""
        if name in _MODULE_AND_ATTRIBUTE_BY_PUBLIC_NAME:
            value = globals()[name] = _import_attribute(_MODULE_AND_ATTRIBUTE_BY_PUBLIC_NAME[name])
            return value
        if name in _FUNCTION_BY_NAME_OF_CALLABLE_SUBPACKAGE:
            from importlib import import_module

            return import_module(f"{__name__}.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        """List the public names, and the rooms that are imported."""
        return sorted({*globals(), *__all__})


class _CallableRoom(ModuleType):
    """A room with the name of a public function: `cwcli.report(...)` calls that, `cwcli.report.page` is in it."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.__wrapped__(*args, **kwargs)

    @property
    def __wrapped__(self) -> Any:
        return _import_attribute(_FUNCTION_BY_NAME_OF_CALLABLE_SUBPACKAGE[self.__name__.rpartition(".")[2]])

    @property
    def __signature__(self) -> Any:
        from inspect import signature

        return signature(self.__wrapped__)


class _Package(ModuleType):
    """This package; a room that is imported into it becomes callable if it has the name of a public function."""

    def __setattr__(self, name: str, value: object) -> None:
        if name in _FUNCTION_BY_NAME_OF_CALLABLE_SUBPACKAGE and type(value) is ModuleType:
            value.__class__ = _CallableRoom
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
