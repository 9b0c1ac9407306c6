"""Says in plain words why a remote log can't be read: the server's answer, or the reason of a failed connection.

Every store's library has its own errors, which hide the reason in a chain of causes. All causes are examined by their
attributes and class names, without importing any of these libraries.
"""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator

from cwcli.errors import InputError
from cwcli.url import display_name_of_url, redact_url, redact_urls

MAX_EXAMINED_ERRORS_OF_CHAIN = 20
"""The greatest number of errors of one chain that are examined; a chain may lead back to itself. Chosen by hand."""
MAX_SHOWN_CHARS_OF_ERROR = 300
"""The number of characters of the words of a server or library that are shown. Chosen by hand."""
SECRET_ENVIRONMENT_NAME_PATTERN = re.compile("KEY|TOKEN|SECRET|PASSWORD|CREDENTIAL|SIGNATURE|CONNECTION_STRING")
"""Parts of the names of environment variables in which stores look for what a user may read with, and of the names in
a connection string of Azure (`AccountName=...;AccountKey=...`)."""
FILE_ENVIRONMENT_NAME_PATTERN = re.compile("_FILE$|^GOOGLE_APPLICATION_CREDENTIALS$")
"""Names of environment variables that say in which file a secret is; the file's name is none."""
MIN_CHARS_OF_ENVIRONMENT_SECRET = 8
"""Least number of characters of such a variable that is hidden. Chosen by hand: shorter ones are parts of words."""
HTTP_NOT_ALLOWED, HTTP_NO_SUCH_FILE, HTTP_TRY_LATER = {401, 403, 407}, {404, 410}, {408, 425, 429}
"""The status codes of HTTP by their meaning for a reader (https://www.rfc-editor.org/rfc/rfc9110#section-15)."""
HTTP_SERVER_ERRORS = range(500, 600)
"""The status codes of HTTP for errors of the server (https://www.rfc-editor.org/rfc/rfc9110#section-15.6)."""
FTP_NOT_ALLOWED, FTP_NO_SUCH_FILE = {530, 532}, {450, 550}
"""The replies of FTP by their meaning for a reader (https://www.rfc-editor.org/rfc/rfc959#section-4.2)."""
ERROR_CLASSES_BY_REASON = {
    "certificate": {"SSLCertVerificationError", "ClientConnectorCertificateError"},
    "refused": {"ConnectionRefusedError"},
    "unknown host": {"gaierror", "ClientConnectorDNSError"},
    "too slow": {"TimeoutError"},
    "broken off": {"ClientPayloadError", "IncompleteRead", "ServerDisconnectedError", "ConnectionResetError"}
    | {"ConnectionAbortedError", "EOFError"},
    "allowed": {"PermissionError"},
}
"""Reason -> names of error classes of Python, aiohttp and http.client that mean it."""
UNREACHABLE_ERROR_NUMBERS = frozenset({errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN})
"""The error numbers of the system for a host that can't be reached."""
TEXT_AND_HINT_BY_REASON = {
    "allowed": (
        "the server does not allow it",
        "check the user name, the password or the signature; it may be too old",
    ),
    "missing": ("there is no such file", ""),
    "later": ("the server can't answer now", "try again later"),
    "refused": ("the server refused the connection", "check the host and the port, and whether the server runs"),
    "unknown host": ("there is no such host, or no network", "check the host's name"),
    "unreachable": ("the server can't be reached", "check the host and the network"),
    "too slow": ("the server did not answer in time", "try again later, or wait longer with --timeout SECONDS"),
    "broken off": ("the connection broke before the whole file had come", "try again"),
    "certificate": ("the server's certificate is not trusted", "check the host's name and the date of this machine"),
}
"""Reason -> text of the error, and advice to the user."""


def unreadable_url_error(url: str, error: BaseException) -> InputError:
    """Return the error that a URL can't be read, with the store's reason."""
    chain = list(_iter_causes(error))
    status = next((code for code in map(_server_status, chain) if code is not None), None)
    reason = _reason_from_connection_errors(chain)
    if status is not None and reason != "broken off":  # which aiohttp calls status 400
        reason = _reason_from_http_status(status)
    words = words_without_secrets(error, url) or type(error).__name__
    detail = f" (status {status})" if status is not None and reason != "broken off" else ""
    if reason is None and isinstance(error, FileNotFoundError) and _is_only_the_file_name(words, redact_url(url)):
        words = "the server does not send it"
        if status is None:
            reason, detail = "missing", _in_brackets(words_without_secrets(error.__cause__ or "", url))
    if reason == "missing":  # a store says so where the whole bucket is not there
        said = (words_without_secrets(each, url) for each in chain)
        bucket = next((each for each in said if "bucket does not exist" in each.lower()), "")
        detail = _in_brackets(bucket) or detail
    what, hint = (words[:MAX_SHOWN_CHARS_OF_ERROR], "") if reason is None else TEXT_AND_HINT_BY_REASON[reason]
    return InputError(f"it can't be read: {what}{detail}", where=display_name_of_url(url), hint=hint)


def _in_brackets(words: str) -> str:
    """Return words to show in brackets behind a reason, for example that the bucket does not exist; "" if none."""
    return f" ({words[:MAX_SHOWN_CHARS_OF_ERROR]})" if words else ""


def words_without_secrets(said: object, url: str) -> str:
    """Return what a server or library says on one line, without the secrets of the URL and of the environment."""
    return redact_urls(" ".join(str(said).split()), url, _iter_environment_secrets())


def _iter_environment_secrets() -> Iterator[str]:
    """Yield the secrets of the environment, each on one line, and those inside connection strings."""
    from urllib.parse import unquote

    for name, value in os.environ.items():
        if not _is_name_of_secret(name) or FILE_ENVIRONMENT_NAME_PATTERN.search(name.upper()):
            continue
        named = (part.partition("=") for part in {*value.split(";"), *re.split("[;&?]", value)})
        for each in (value, *(own for part_name, _, own in named if _is_name_of_secret(part_name))):
            for secret in {" ".join(spelling.split()) for spelling in (each, unquote(each))}:
                if len(secret) >= MIN_CHARS_OF_ENVIRONMENT_SECRET:
                    yield secret


def _is_name_of_secret(name: str) -> bool:
    return name.lower() == "sig" or SECRET_ENVIRONMENT_NAME_PATTERN.search(name.upper()) is not None


def _iter_causes(error: BaseException) -> Iterator[BaseException]:
    each: BaseException | None = error
    for _ in range(MAX_EXAMINED_ERRORS_OF_CHAIN):
        if each is None:
            return
        yield each
        inner = getattr(each, "os_error", None)  # of aiohttp's connector
        each = inner if isinstance(inner, BaseException) else each.__cause__ or each.__context__


def _server_status(error: BaseException) -> int | None:
    """Return the server's HTTP status from an error of aiohttp, botocore, gcsfs, azure or ftplib, else None."""
    response = getattr(error, "response", None)
    found = None
    if isinstance(response, dict):
        found = response.get("ResponseMetadata", {}).get("HTTPStatusCode")
    for name in ("status", "status_code", "code"):
        found = getattr(error, name, None) if found is None else found
    if type(error).__module__ == "ftplib":
        reply = re.match(r"[45]\d\d\b", str(error))
        found = _http_status_of_ftp_reply(int(reply.group())) if reply else None
    is_status = isinstance(found, int) and 400 <= found < 600
    return found if is_status else None


def _http_status_of_ftp_reply(reply: int) -> int:
    """Return the HTTP status with the same meaning as a reply of FTP."""
    if reply in FTP_NOT_ALLOWED:
        return 401
    if reply in FTP_NO_SUCH_FILE:
        return 404
    return 503 if reply < 500 else 400


def _reason_from_http_status(status: int) -> str | None:
    if status in HTTP_NOT_ALLOWED:
        return "allowed"
    if status in HTTP_NO_SUCH_FILE:
        return "missing"
    return "later" if status in HTTP_TRY_LATER or status in HTTP_SERVER_ERRORS else None


def _reason_from_connection_errors(chain: list[BaseException]) -> str | None:
    """Return the first reason, in the order of `ERROR_CLASSES_BY_REASON`, that one of the errors means, else None."""
    names = {kind.__name__ for error in chain for kind in type(error).__mro__}
    numbers = {error.errno for error in chain if isinstance(error, OSError)}
    if numbers & UNREACHABLE_ERROR_NUMBERS:
        return "unreachable"
    return next((reason for reason, classes in ERROR_CLASSES_BY_REASON.items() if names & classes), None)


def _is_only_the_file_name(words: str, url: str) -> bool:
    """Tell whether an error text is nothing but the name of the missing file."""
    return words.rstrip("/").rpartition("/")[2] == url.rstrip("/").rpartition("/")[2]
