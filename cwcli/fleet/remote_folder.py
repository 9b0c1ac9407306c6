"""Copy a folder of an object store to this machine."""

from __future__ import annotations

from pathlib import Path

from cwcli.errors import InputError, UsageError
from cwcli.logs.read.remote import WEB_PREFIXES, file_system_and_path, iter_remote_blocks
from cwcli.logs.read.remote_errors import unreadable_url_error
from cwcli.output import make_folder, open_output
from cwcli.url import display_name_of_url


def copy_remote_folder(url: str, target: Path) -> None:
    """Copy all files below a URL of a store to a folder of this machine.

    Raises:
        InputError: There are none, they can't be read, or one has a name that leads elsewhere.
        OutputError: They can't be written.
        UsageError: The URL is of the web, which has no folders, or it needs a package that is not installed.
    """
    if url.startswith(WEB_PREFIXES):
        raise UsageError("a web server has no folders", where=display_name_of_url(url), hint="copy it to this machine")
    system, path = file_system_and_path(url)
    base = path.rstrip("/") + "/"
    try:
        names = [str(name) for name in system.find(base)]
    except Exception as error:  # each store has its own errors
        raise unreadable_url_error(url, error) from error
    if not names:
        raise InputError("there is no such folder", where=display_name_of_url(url))
    for name in names:
        parts = name.removeprefix(base).split("/")
        if not name.startswith(base) or {"", ".", ".."} & {*parts} or any(set(each) & {"\\", "\0"} for each in parts):
            raise InputError(f"the name {name!r} leads out of the folder", where=display_name_of_url(url))
        own = target.joinpath(*parts)
        make_folder(own.parent, parents=True)
        with open_output(own, force=True, durable=False) as output:
            for block in iter_remote_blocks(system.unstrip_protocol(name)):
                output.write(block)
