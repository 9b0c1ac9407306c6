"""URLs in names and messages: without the passwords, tokens and signatures that they carry.

`redact_url` is the only place that decides what of a URL may be printed or written. The URL as the user gave it goes
to the store alone.

What is hidden: user name and password, the whole query, the fragment. A host, a port and a path stay; a secret that a
service puts into a path can't be told from a folder's name.

Syntax: https://www.rfc-editor.org/rfc/rfc3986#section-3
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

HIDDEN_URL_PART_TEXT = "***"
"""The text that replaces a part of a URL that is not shown."""
URL_SCHEMES_WITH_CONTAINER_BEFORE_AT_SIGN = frozenset({"abfs", "abfss", "wasb", "wasbs"})
"""Schemes of Azure, where `container@account` names a container in front of the `@`, and no user."""
URL_SCHEMES_WHERE_QUESTION_MARK_BEGINS_QUERY = frozenset({"http", "https"})
"""Schemes where every `?` begins a query. In others it may be a pattern (`s3://bucket/drive-?.mcap`)."""
PREFIXES_OF_URL_SIGNATURE_PARAMETER_NAMES = ("x-amz-", "x-goog-", "x-oss-", "x-cos-", "x-obs-")
"""Beginnings of the parameters with which object stores sign a URL: Amazon, Google, Alibaba, Tencent, Huawei."""
ACCESS_PARAMETER_NAMES = frozenset(
    {"access_token", "access-token", "accesskeyid", "api_key", "api-key", "apikey", "auth", "auth_token"}
    | {"authorization", "awsaccesskeyid", "client_secret", "credential", "credentials", "expire", "expires"}
    | {"googleaccessid", "hmac", "id_token", "jwt", "key-pair-id", "ossaccesskeyid", "pass", "passwd", "password"}
    | {"pwd", "secret", "security-token", "sig", "signature", "token"}
)
"""Names of parameters that say who may read, not what is read; compared without regard to case. A name that could be
either, `key` for example, is not among them: two files must never be taken for one."""
AZURE_SIGNATURE_PARAMETER_NAMES = frozenset(
    {"saoid", "scid", "se", "sip", "ske", "skoid", "sks", "skt", "sktid", "skv"}
    | {"sp", "spr", "sr", "srt", "ss", "st", "suoid", "sv"}
)
"""Names of the query parameters of Azure's shared access signatures, beside `sig` (Azure Storage REST API)."""
PBKDF2_ROUNDS_OF_SECRET_DIGEST = 50_000
"""Number of PBKDF2 rounds. Chosen by hand: each guess at a short secret in an unknown parameter costs 30 ms."""
SECRET_DIGEST_HEX_DIGITS = 8
"""Number of hexadecimal digits of a digest; so few that many secrets have the same one. Chosen by hand."""
MIN_CHARS_OF_HIDDEN_VALUE = 3
"""Least number of characters of a value that is hidden in the words of others: `t=1` would hide every 1. Chosen by
hand."""

# plain strings, as `re` compiles them when the first URL comes: most runs have none
_SCHEME_PATTERN = r"[A-Za-z][A-Za-z0-9+.\-]{0,40}://"
"""The beginning of a URL: its scheme (RFC 3986, section 3.1) and `://`. Without a bound, the search would take the
square of the length of a text: minutes for one that a server writes."""
_URL_PATTERN = _SCHEME_PATTERN + r"[^\s<>\"`\\^{|}]*"
"""A URL in a sentence: everything up to a space or a character that no URL holds (RFC 3986)."""
_TRAILING_PUNCTUATION = "'),.;:]"
"""Characters at the end of a URL in running text that are the sentence's punctuation, not the URL's."""
_NAME_WITH_DIGEST_PATTERN = r"(?s)(.*\?\*\*\*(?:#\*\*\*)?)( \([0-9a-f]{8}\))"
"""The name of a URL whose secrets are hidden, and the digest behind it (`display_name_of_url`)."""


def redact_url(url: str) -> str:
    """A URL without its secrets: `https://***@host/drive.mcap?***#***`. Other text comes back as it is."""
    found = list(re.finditer(_SCHEME_PATTERN, url)) if "://" in url else []
    if not found:
        return url
    if named := re.fullmatch(_NAME_WITH_DIGEST_PATTERN, url):
        return redact_url(named[1]) + named[2]
    # one URL may hold another: `simplecache::https://...`, `https://host/?from=https://...`
    begin, end = found[0].span()
    for following in found[1:]:
        if set("?#") & set(url[end : following.start()]):
            break
        begin, end = following.span()
    scheme = url[begin : end - 3].lower()
    user, host, path, query, fragment = _split_url_behind_scheme(scheme, url[end:])
    if user is not None:
        is_container = scheme in URL_SCHEMES_WITH_CONTAINER_BEFORE_AT_SIGN and ":" not in user
        host = f"{user if is_container else HIDDEN_URL_PART_TEXT}@{host}"
    shown = f"{url[:end]}{host}{path}"
    shown += f"?{HIDDEN_URL_PART_TEXT}" if query is not None else ""
    return shown + (f"#{HIDDEN_URL_PART_TEXT}" if fragment is not None else "")


def redact_urls(text: str, url: str = "", more_secrets: Iterable[str] = ()) -> str:
    """Words that others wrote, an error's for example, without the secrets of the URLs in them.

    Args:
        url: The URL of which they speak. Its secrets are hidden wherever they stand, also without the rest of the URL.
        more_secrets: Further texts to hide.
    """
    text = text.replace(url, redact_url(url)) if url else text
    if "://" in text:
        text = re.sub(_URL_PATTERN, _redact_match, text)
    # one may be a part of another
    for secret in sorted({*_secret_spellings(url), *more_secrets}, key=lambda each: (-len(each), each)):
        text = text.replace(secret, HIDDEN_URL_PART_TEXT)
    return text


@lru_cache(maxsize=10_000)
def display_name_of_url(url: str) -> str:
    """What a log with this URL is called: the URL without its secrets, told apart from others that look alike then.

    Two signatures of one file are one name. Parameters that may say which file is meant (`?id=7`) give the name a
    salted digest: `https://host/download?*** (3f2a91cc)`.
    """
    shown = redact_url(url)
    scheme, _, rest = url.rpartition("::")[2].partition("://")
    query = _split_url_behind_scheme(scheme.lower(), rest).query
    telling = _identifying_parameters(query) if query is not None else []
    if not telling:
        return shown
    import hashlib

    salt = f"cwcli {shown}".encode("utf-8", "surrogateescape")
    basis = repr(telling).encode("utf-8", "surrogateescape")
    digest = hashlib.pbkdf2_hmac("sha256", basis, salt, PBKDF2_ROUNDS_OF_SECRET_DIGEST).hex()
    return f"{shown} ({digest[:SECRET_DIGEST_HEX_DIGITS]})"


def path_of_url(url: str) -> str:
    """The path of a URL, without host, query and fragment: where a pattern may stand."""
    scheme, _, rest = url.partition("://")
    return _split_url_behind_scheme(scheme.lower(), rest).path


def _identifying_parameters(query: str) -> list[tuple[str, str]]:
    """The parameters of a query that may say which file is meant, in order of their names."""
    from urllib.parse import parse_qsl

    pairs = parse_qsl(query, keep_blank_values=True)
    names = {name.lower() for name, _ in pairs}
    signing = ACCESS_PARAMETER_NAMES | (AZURE_SIGNATURE_PARAMETER_NAMES if "sig" in names else frozenset())
    return sorted(
        (name, value)
        for name, value in pairs
        if name.lower() not in signing and not name.lower().startswith(PREFIXES_OF_URL_SIGNATURE_PARAMETER_NAMES)
    )


def _redact_match(match: re.Match[str]) -> str:
    found = match.group()
    url = found.rstrip(_TRAILING_PUNCTUATION)
    return redact_url(url) + found[len(url) :]


def encode_credentials(user: str) -> str:
    """The user name and password of a URL as a request's header carries them (RFC 7617, section 2)."""
    from base64 import b64encode
    from urllib.parse import unquote

    name, _, password = user.partition(":")
    # bytes of the command line that are no UTF-8 are surrogates in it, and sent as they were typed
    return b64encode(f"{unquote(name)}:{unquote(password)}".encode("utf-8", "surrogateescape")).decode("ascii")


class UrlParts(NamedTuple):
    """The parts of a URL behind `scheme://`; None for one that is not there."""

    user: str | None
    host: str
    path: str
    query: str | None
    fragment: str | None


def _split_url_behind_scheme(scheme: str, rest: str) -> UrlParts:
    authority = re.match(r"[^/?#]*", rest)
    assert authority is not None
    length = authority.end()
    if "@" not in authority.group() and "@" in rest and _is_no_host_with_port(authority.group()):
        length = rest.rindex("@") + 1  # the password holds a character that should have been escaped
        length += len(re.match(r"[^/?#]*", rest[length:]).group())  # type: ignore[union-attr]
    user, at, host = rest[:length].rpartition("@")
    tail = rest[length:]
    tail, hash_mark, fragment = tail.partition("#")
    at_query = tail.find("?")
    if at_query >= 0 and scheme not in URL_SCHEMES_WHERE_QUESTION_MARK_BEGINS_QUERY and "=" not in tail[at_query:]:
        at_query = -1
    path, query = (tail, None) if at_query < 0 else (tail[:at_query], tail[at_query + 1 :])
    return UrlParts(user if at else None, host, path, query, fragment if hash_mark else None)


def _is_no_host_with_port(authority: str) -> bool:
    """Whether what stands in front of the first `/`, `?` or `#` is no host with a port."""
    _, colon, port = authority.rpartition("]")[2].partition(":")
    return bool(colon) and not port.isdecimal()


def _secret_spellings(url: str) -> list[str]:
    """What is hidden of a URL, in every spelling that a library may give it."""
    match = re.search(_SCHEME_PATTERN, url) if "://" in url else None
    if match is None:
        return []
    from urllib.parse import unquote, unquote_plus

    scheme = match.group()[:-3].lower()
    user, _, _, query, fragment = _split_url_behind_scheme(scheme, url[match.end() :])
    if scheme in URL_SCHEMES_WITH_CONTAINER_BEFORE_AT_SIGN and user is not None and ":" not in user:
        user = None
    name, _, password = (user or "").partition(":")
    raw = [user or "", name, password, query or "", fragment or ""]
    if user:
        raw.append(encode_credentials(user).rstrip("="))
    for pair in re.split("[&;]", query or ""):
        raw.append(pair.partition("=")[2])
    every = {spelling for each in raw for spelling in (each, unquote(each), unquote_plus(each))}
    return [each for each in every if len(each) >= MIN_CHARS_OF_HIDDEN_VALUE]
