"""Why a remote log can't be read, in plain words: what the server answered, or why there is no connection.

Every store's library has its own errors, and hides the reason behind another one; so the whole chain of causes is
looked through, by what the errors have and are called, without importing any of these libraries.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator

from cwcli.errors import InputError
from cwcli.url import name_url, redact_url, redact_urls

MAX_CAUSES = 20
"""Errors of one chain that are looked at; a chain may lead back to itself."""
NOT_ALLOWED, NO_SUCH_FILE, TRY_LATER = {401, 403, 407}, {404, 410}, {408, 425, 429}
"""Status codes of HTTP by what they mean to who reads. https://www.rfc-editor.org/rfc/rfc9110#section-15"""
SERVER_TROUBLE = range(500, 600)
FTP_NOT_ALLOWED, FTP_NO_SUCH_FILE = {530, 532}, {450, 550}
"""Replies of FTP. https://www.rfc-editor.org/rfc/rfc959#section-4.2"""
CONNECTION_TROUBLES = {
    "certificate": {"SSLCertVerificationError", "ClientConnectorCertificateError"},
    "refused": {"ConnectionRefusedError"},
    "unknown host": {"gaierror", "ClientConnectorDNSError"},
    "too slow": {"TimeoutError"},
    "broken off": {"ClientPayloadError", "IncompleteRead", "ServerDisconnectedError", "ConnectionResetError"}
    | {"ConnectionAbortedError", "EOFError"},
    "allowed": {"PermissionError"},
}
"""Reason -> names of classes of errors, of Python, aiohttp and http.client, that mean it."""
UNREACHABLE = frozenset({errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN})
WORDS = {
    "allowed": (
        "the server does not allow it",
        "check the user name, the password or the signature; it may be too old",
    ),
    "missing": ("there is no such file", ""),
    "later": ("the server can't answer now", "try again later"),
    "refused": ("the server refused the connection", "check the host and the port, and whether the server runs"),
    "unknown host": ("there is no such host, or no network", "check the host's name"),
    "unreachable": ("the server can't be reached", "check the host and the network"),
    "too slow": ("the server did not answer in time", "try again later"),
    "broken off": ("the connection broke before the whole file had come", "try again"),
    "certificate": ("the server's certificate is not trusted", "check the host's name and the date of this machine"),
}
"""Reason -> what is said, and what to do."""


def unreadable(url: str, error: BaseException) -> InputError:
    """The error that a URL can't be read, for the store's reason."""
    chain = list(_causes(error))
    status = next((code for code in map(_status, chain) if code is not None), None)
    reason = _reason_of_connection(chain)
    if status is not None and reason != "broken off":  # which aiohttp calls status 400
        reason = _reason_of_status(status)
    words = redact_urls(" ".join(str(error).split()), url) or type(error).__name__
    detail = f" (status {status})" if status is not None and reason != "broken off" else ""
    if reason is None and isinstance(error, FileNotFoundError) and _is_only_a_name(words, redact_url(url)):
        words = "the server does not send it"
        if status is None:
            reason, detail = "missing", _cause_in_brackets(error, url)
    if reason == "missing":  # a store says so where the whole bucket is not there
        said = (" ".join(str(each).split()) for each in chain)
        bucket = next((each for each in said if "bucket does not exist" in each.lower()), "")
        detail = f" ({redact_urls(bucket, url)})" if bucket else detail
    what, hint = (words, "") if reason is None else WORDS[reason]
    return InputError(f"it can't be read: {what}{detail}", where=name_url(url), hint=hint)


def _cause_in_brackets(error: BaseException, url: str) -> str:
    """What led to an error that tells nothing itself, for example that the bucket does not exist."""
    why = redact_urls(" ".join(str(error.__cause__ or "").split()), url)
    return f" ({why})" if why else ""


def _causes(error: BaseException) -> Iterator[BaseException]:
    """The error and what led to it."""
    each: BaseException | None = error
    for _ in range(MAX_CAUSES):
        if each is None:
            return
        yield each
        inner = getattr(each, "os_error", None)  # of aiohttp's connector
        each = inner if isinstance(inner, BaseException) else each.__cause__ or each.__context__


def _status(error: BaseException) -> int | None:
    """What the server answered: of aiohttp, botocore, gcsfs or azure; of ftplib its first three digits."""
    response = getattr(error, "response", None)
    found = None
    if isinstance(response, dict):
        found = response.get("ResponseMetadata", {}).get("HTTPStatusCode")
    for name in ("status", "status_code", "code"):
        found = getattr(error, name, None) if found is None else found
    if type(error).__module__ == "ftplib":
        reply = re.match(r"[45]\d\d\b", str(error))
        found = _http_status(int(reply.group())) if reply else None
    is_status = isinstance(found, int) and 400 <= found < 600
    return found if is_status else None


def _http_status(reply: int) -> int:
    """The status of HTTP that means what a reply of FTP means."""
    if reply in FTP_NOT_ALLOWED:
        return 401
    if reply in FTP_NO_SUCH_FILE:
        return 404
    return 503 if reply < 500 else 400


def _reason_of_status(status: int) -> str | None:
    if status in NOT_ALLOWED:
        return "allowed"
    if status in NO_SUCH_FILE:
        return "missing"
    return "later" if status in TRY_LATER or status in SERVER_TROUBLE else None


def _reason_of_connection(chain: list[BaseException]) -> str | None:
    """The first reason, in the order of `CONNECTION_TROUBLES`, that one of the errors is."""
    names = {kind.__name__ for error in chain for kind in type(error).__mro__}
    numbers = {error.errno for error in chain if isinstance(error, OSError)}
    if numbers & UNREACHABLE:
        return "unreachable"
    return next((reason for reason, classes in CONNECTION_TROUBLES.items() if names & classes), None)


def _is_only_a_name(words: str, url: str) -> bool:
    """Whether an error says no more than the name of what is not there."""
    return words.rstrip("/").rpartition("/")[2] == url.rstrip("/").rpartition("/")[2]
