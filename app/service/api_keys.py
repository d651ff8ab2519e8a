"""API keys: a file that holds their hashes, and the dependency that asks for one."""

import hashlib
import hmac
import re
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from fastapi import Request
from fastapi.openapi.models import HTTPBearer
from fastapi.security.base import SecurityBase

from app.service.errors import UnauthorizedError
from app.service.request_record import record_of
from pricing_core.errors import InvalidInputError, Told

NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")
HASH = re.compile(r"[0-9a-f]{64}")
LONGEST_KEY = 256  # characters of what is presented
RANDOM_BYTES = 32  # of a new key: nobody guesses it, so that its hash needs no salt and no slowness
LIMITS = {"client_queue": int, "seconds_per_minute": float}


@dataclass(frozen=True, slots=True)
class KeyLimits:
    """The limits of the holder of a key; None where the settings apply, or where there is no limit.

    Parameters
    ----------
    client_queue : int or None
        Expensive questions that wait or are in work.
    seconds_per_minute : float or None
        Thread seconds that expensive questions may take in a minute.
    """

    client_queue: int | None = None
    seconds_per_minute: float | None = None


@dataclass(frozen=True, slots=True)
class ApiKey:
    """A key's owner, its SHA-256, and its limits."""

    name: str
    digest: bytes
    limits: KeyLimits


def new_key(name: str) -> tuple[str, str]:
    """Return a new key, and the line of the file that admits it.

    Raises
    ------
    InvalidInputError
        The name is no plain word.
    """
    if not NAME.fullmatch(name):
        raise InvalidInputError("NAME", name, "1 to 64 letters, digits, dots, underscores and hyphens")
    key = "pk_" + secrets.token_urlsafe(RANDOM_BYTES)
    return key, f"{name} {_digest(key).hex()}"


def read_keys(path: str) -> list[ApiKey]:
    """Read a file of keys: one `NAME SHA256-HEX [limit=value ...]` per line; `#` begins a comment.

    A name may stand in several lines, with a key each: that is how a key is replaced without an interruption.

    Raises
    ------
    InvalidInputError
        A line is none of these, two lines of one name differ in their limits, or there is no key at all.
    OSError
        The file cannot be read.
    """
    lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    found = [_read(line.split(), f"{path}, line {number}") for number, line in _with_content(lines)]
    limits: dict[str, KeyLimits] = {}
    for key in found:
        if limits.setdefault(key.name, key.limits) != key.limits:
            raise InvalidInputError(path, Told(key.name), "given the same limits in each of its lines")
    if not found:
        raise InvalidInputError(path, Told("no key"), "a file with at least one key")
    return found


def _with_content(lines: Iterable[str]) -> Iterable[tuple[int, str]]:
    bare = ((number, line.partition("#")[0].strip()) for number, line in enumerate(lines, 1))
    return ((number, line) for number, line in bare if line)


def _read(words: list[str], where: str) -> ApiKey:
    """Read one line; what is wrong is said without repeating it: it may be a key."""
    name, digest, *others = [*words, ""] if len(words) == 1 else words
    if not NAME.fullmatch(name) or not HASH.fullmatch(digest.lower()):
        raise InvalidInputError(where, Told("..."), "NAME and SHA256-HEX, as pricing key prints them")
    values = dict(_limit(other, where) for other in others)
    return ApiKey(name, bytes.fromhex(digest), KeyLimits(**values))  # type: ignore[arg-type]


def _limit(word: str, where: str) -> tuple[str, float]:
    name, _, text = word.partition("=")
    try:
        value = LIMITS[name](text)
    except (KeyError, ValueError):
        value = 0
    if not 0 < value < float("inf"):
        raise InvalidInputError(where, Told("a limit"), f"{' or '.join(LIMITS)}, = and a number above 0")
    return name, value


class KeyCheck(SecurityBase):
    """The dependency of a route that requires a key; the owner of the key becomes the request's client."""

    scheme_name = "key"
    model = HTTPBearer(description="A key that the operator of the service has given out.")

    def __init__(self, keys: Iterable[ApiKey]) -> None:
        self._keys = tuple(keys)

    async def __call__(self, request: Request) -> None:
        """Let a request pass, as its key's owner.

        Raises
        ------
        UnauthorizedError
            It has no key, more than one, or an unknown one.
        """
        given = request.headers.getlist("authorization")
        scheme, _, presented = given[0].partition(" ") if len(given) == 1 else ("", "", "")
        if scheme.lower() != "bearer":
            raise UnauthorizedError("the header must be given once: Authorization: Bearer KEY")
        key = self._owner(presented.strip())
        if key is None:
            raise UnauthorizedError("the key is not known here", error="invalid_token")
        request.state.key_limits = key.limits
        record_of(request).client = key.name

    def _owner(self, presented: str) -> ApiKey | None:
        """Return the key; it takes as long whichever it is, and whether or not it is one."""
        digest, found = _digest(presented[:LONGEST_KEY]), None
        for key in self._keys:
            if hmac.compare_digest(digest, key.digest):
                found = key
        return found


def _digest(key: str) -> bytes:
    return hashlib.sha256(key.encode("utf-8", "surrogateescape")).digest()
