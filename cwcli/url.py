"""URLs in names and messages: without the passwords, tokens and signatures that they carry.

`redact_url` is the only place that decides what of a URL may be printed or written. The URL as the user gave it goes
to the store alone.

What is hidden: user name and password, the whole query, the fragment. A host, a port and a path stay; a secret that a
service puts into a path can't be told from a folder's name.

Syntax: https://www.rfc-editor.org/rfc/rfc3986#section-3
"""

from __future__ import annotations

import re
from functools import lru_cache

HIDDEN = "***"
"""The text that replaces a part of a URL that is not shown."""
CONTAINER_SCHEMES = frozenset({"abfs", "abfss", "wasb", "wasbs"})
"""Schemes of Azure, where `container@account` names a container in front of the `@`, and no user."""
QUERY_SCHEMES = frozenset({"http", "https"})
"""Schemes where every `?` begins a query. In others it may be a pattern (`s3://bucket/drive-?.mcap`)."""
SIGNATURE_PREFIXES = ("x-amz-", "x-goog-", "x-oss-", "x-cos-", "x-obs-")
"""Beginnings of the parameters with which object stores sign a URL: Amazon, Google, Alibaba, Tencent, Huawei."""
SIGNATURE_NAMES = frozenset(
    {"access_token", "access-token", "accesskeyid", "api_key", "api-key", "apikey", "auth", "auth_token"}
    | {"authorization", "awsaccesskeyid", "client_secret", "credential", "credentials", "expire", "expires"}
    | {"googleaccessid", "hmac", "id_token", "jwt", "key-pair-id", "ossaccesskeyid", "pass", "passwd", "password"}
    | {"pwd", "secret", "security-token", "sig", "signature", "token"}
)
"""Names of parameters that say who may read, not what is read; compared without regard to case. A name that could be
either, `key` for example, is not among them: two files must never be taken for one."""
SAS_NAMES = frozenset(
    {"saoid", "scid", "se", "sip", "ske", "skoid", "sks", "skt", "sktid", "skv"}
    | {"sp", "spr", "sr", "srt", "ss", "st", "suoid", "sv"}
)
"""Names of the query parameters of Azure's shared access signatures, beside `sig`
(https://learn.microsoft.com/rest/api/storageservices/create-service-sas)."""
DIGEST_ROUNDS = 50_000
"""Number of PBKDF2 rounds, 30 ms a URL: what each guess at a short secret in a parameter of an unknown name costs."""
DIGEST_LENGTH = 8
"""Number of hexadecimal digits of the digest; it is small so that many secrets share a digest. Chosen by hand."""
MIN_SECRET_LENGTH = 3
"""Fewest characters of a value that is hidden outside of its URL, because `t=1` would hide every 1; chosen by hand."""

# plain strings, as `re` compiles them when the first URL comes: most runs have none
_SCHEME = r"[A-Za-z][A-Za-z0-9+.\-]*://"
"""Pattern of a URL's scheme with `://` behind it (RFC 3986, section 3.1)."""
_URL = _SCHEME + r"[^\s<>\"`\\^{|}]*"
"""Pattern of a URL within a text: a scheme and all characters that may follow it."""
_TRAILING = "'),.;:]"
"""Punctuation that belongs to the sentence and not to the URL in front of it."""
_NAME_WITH_DIGEST = r"(?s)(.*\?\*\*\*(?:#\*\*\*)?)( \([0-9a-f]{8}\))"
"""Pattern of a name by `name_url`: a URL without its secrets, and the digest behind it."""


def redact_url(url: str) -> str:
    """A URL without its secrets: `https://***@host/drive.mcap?***#***`. Other text comes back as it is."""
    found = list(re.finditer(_SCHEME, url)) if "://" in url else []
    if not found:
        return url
    if named := re.fullmatch(_NAME_WITH_DIGEST, url):
        return redact_url(named[1]) + named[2]
    # one URL may hold another: `simplecache::https://...`, `https://host/?from=https://...`
    begin, end = found[0].start(), found[0].end()
    scheme = url[begin : end - 3].lower()
    if len(found) > 1 and not set("?#") & set(url[end : found[1].start()]):
        return url[: found[1].start()] + redact_url(url[found[1].start() :])
    user, host, path, query, fragment = _split(scheme, url[end:])
    if user is not None:
        is_container = scheme in CONTAINER_SCHEMES and ":" not in user
        host = f"{user if is_container else HIDDEN}@{host}"
    shown = f"{url[:end]}{host}{path}"
    shown += f"?{HIDDEN}" if query is not None else ""
    return shown + (f"#{HIDDEN}" if fragment is not None else "")


def redact_urls(text: str, url: str = "") -> str:
    """Return a text, for example of a library's error, without the secrets of the URLs in it.

    Args:
        text: The text.
        url: The URL that the text is about. Its secrets are hidden wherever they occur, even without the URL.
    """
    text = text.replace(url, redact_url(url)) if url else text
    if "://" in text:
        text = re.sub(_URL, _redact_match, text)
    for secret in _secrets(url):
        text = text.replace(secret, HIDDEN)
    return text


@lru_cache(maxsize=10_000)
def name_url(url: str) -> str:
    """Return the name of a log with this URL: the URL without its secrets, and a digest where that is ambiguous.

    Two signatures of one file are one name. Parameters that may say which file is meant (`?id=7`) give the name a
    salted digest: `https://host/download?*** (3f2a91cc)`.
    """
    shown = redact_url(url)
    scheme, _, rest = url.rpartition("::")[2].partition("://")
    query = _split(scheme.lower(), rest)[3]
    telling = _telling(query) if query is not None else []
    if not telling:
        return shown
    import hashlib

    salt = f"cwcli {shown}".encode("utf-8", "surrogateescape")
    basis = repr(telling).encode("utf-8", "surrogateescape")
    digest = hashlib.pbkdf2_hmac("sha256", basis, salt, DIGEST_ROUNDS).hex()
    return f"{shown} ({digest[:DIGEST_LENGTH]})"


def path_of_url(url: str) -> str:
    """Return the path of a URL, without host, query and fragment; only it may hold a pattern."""
    scheme, _, rest = url.partition("://")
    return _split(scheme.lower(), rest)[2]


def _telling(query: str) -> list[tuple[str, str]]:
    """Return the parameters of a query that may identify the file, ordered by name."""
    from urllib.parse import parse_qsl

    pairs = parse_qsl(query, keep_blank_values=True)
    names = {name.lower() for name, _ in pairs}
    signing = SIGNATURE_NAMES | (SAS_NAMES if "sig" in names else frozenset())
    return sorted(
        (name, value)
        for name, value in pairs
        if name.lower() not in signing and not name.lower().startswith(SIGNATURE_PREFIXES)
    )


def _redact_match(match: re.Match[str]) -> str:
    """Return a URL that was found in a text without its secrets; punctuation behind it stays."""
    found = match.group()
    url = found.rstrip(_TRAILING)
    return redact_url(url) + found[len(url) :]


def _split(scheme: str, rest: str) -> tuple[str | None, str, str, str | None, str | None]:
    """Split the text behind `scheme://` into user information, host, path, query and fragment; None where absent."""
    authority = re.match(r"[^/?#]*", rest)
    assert authority is not None
    length = authority.end()
    if "@" not in authority.group() and "@" in rest and _is_cut_password(authority.group()):
        length = rest.rindex("@") + 1  # the password holds a character that should have been escaped
        length += len(re.match(r"[^/?#]*", rest[length:]).group())  # type: ignore[union-attr]
    user, at, host = rest[:length].rpartition("@")
    tail = rest[length:]
    tail, hash_mark, fragment = tail.partition("#")
    at_query = tail.find("?")
    if at_query >= 0 and scheme not in QUERY_SCHEMES and "=" not in tail[at_query:]:
        at_query = -1
    path, query = (tail, None) if at_query < 0 else (tail[:at_query], tail[at_query + 1 :])
    return user if at else None, host, path, query, fragment if hash_mark else None


def _is_cut_password(authority: str) -> bool:
    """Return whether the text up to the first `/`, `?` or `#` is not a host with a port, but a cut password."""
    _, colon, port = authority.rpartition("]")[2].partition(":")
    return bool(colon) and not port.isdecimal()


def _secrets(url: str) -> list[str]:
    """Return the secrets of a URL in every spelling that a library may use, the longest first."""
    match = re.search(_SCHEME, url) if "://" in url else None
    if match is None:
        return []
    from urllib.parse import unquote, unquote_plus

    scheme = match.group()[:-3].lower()
    user, _, _, query, fragment = _split(scheme, url[match.end() :])
    if scheme in CONTAINER_SCHEMES and user is not None and ":" not in user:
        user = None
    name, _, password = (user or "").partition(":")
    raw = [user or "", name, password, query or "", fragment or ""]
    for pair in re.split("[&;]", query or ""):
        raw.append(pair.partition("=")[2])
    every = {spelling for each in raw for spelling in (each, unquote(each), unquote_plus(each))}
    return sorted((each for each in every if len(each) >= MIN_SECRET_LENGTH), key=lambda each: (-len(each), each))
