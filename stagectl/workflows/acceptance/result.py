"""What an acceptance found, as data that is signed: steps, distances against their bounds, who, when, with what.

::

    {"content": {...}, "sha256": "...", "hmac_sha256": "..." | null}

The hash is over the content as JSON with sorted keys and without spaces (UTF-8).  It shows a change by accident; only
the HMAC (RFC 2104), with a key that others do not have, shows one on purpose.
"""

import enum
import hashlib
import hmac
import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from stagectl.problem import absent, why_unread
from stagectl.units import StageError
from stagectl.workflows.acceptance.limits import SHORTEST_KEY
from stagectl.workflows.acceptance.traces import Trace

FORMAT = "stagectl-acceptance/1"
_PARTS = ("content", "sha256", "hmac_sha256")


class Outcome(enum.Enum):
    """How a step ended."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


class StepResult(NamedTuple):
    """One step; distances in m of the table, or in rad."""

    name: str
    title: str
    outcome: Outcome
    words: str
    facts: Mapping[str, Any] = MappingProxyType({})  # JSON values
    measured: float | None = None
    bound: float | None = None
    traces: tuple[Trace, ...] = ()  # of its trials under power

    def content(self) -> dict[str, Any]:
        """All of it as JSON values."""
        traces = [trace._asdict() for trace in self.traces]
        return {**self._asdict(), "outcome": self.outcome.value, "facts": dict(self.facts), "traces": traces}


class Acceptance(NamedTuple):
    """A whole acceptance."""

    stage: str
    stage_file: str
    stage_sha256: str
    eds_sha256: str
    person: str
    date: str  # ISO 8601, with the offset to UTC
    virtual: bool
    unit: str  # of the distances: m | rad
    drive: dict[str, str]
    software: dict[str, str]
    steps: tuple[StepResult, ...]

    @property
    def accepted(self) -> bool:
        """Whether each step was done, and passed."""
        return bool(self.steps) and all(step.outcome is Outcome.PASSED for step in self.steps)

    def content(self) -> dict[str, Any]:
        """All of it as JSON values."""
        steps = [step.content() for step in self.steps]
        return {"format": FORMAT, "accepted": self.accepted, **self._asdict(), "steps": steps}


def signed(result: Acceptance, key: bytes | None = None) -> dict[str, Any]:
    """The content with its hash and, with a `key`, its HMAC."""
    content = result.content()
    return {"content": content, "sha256": _hash(content), "hmac_sha256": None if key is None else _hmac(content, key)}


def verify(path: Path, key: bytes | None = None) -> dict[str, Any]:
    """The content of a signed page's JSON.

    Raises StageError where it is no such file, was changed, or was not signed with this `key`.
    """
    if not path.is_file():
        raise StageError(f"{path}: {absent(path)}")
    content, digest, code = _parts(path)
    if not hmac.compare_digest(digest, _hash(content)):
        raise StageError(f"{path} was changed after it was signed: its SHA-256 is not {digest}")
    if key is not None and not hmac.compare_digest(str(code), _hmac(content, key)):
        raise StageError(f"{path} was not signed with this key: its HMAC is {code}")
    return content


def _parts(path: Path) -> tuple[dict[str, Any], str, Any]:
    """Content, hash and HMAC as the file has them."""
    other = f"{path} is not the JSON of `stagectl drive accept`"
    remedy = "give the .json that it wrote next to the page; `ls *.json` shows what is here"
    try:
        page = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise StageError(f"{other}: {why_unread(error)}; {remedy}") from error
    lacking = [name for name in _PARTS if name not in page] if isinstance(page, dict) else [*_PARTS]
    if lacking or not isinstance(page["content"], dict):
        raise StageError(f"{other}: it has no {', '.join(lacking) or 'object under content'}; {remedy}")
    return page["content"], str(page["sha256"]), page["hmac_sha256"]


def read_key(path: Path) -> bytes:
    """A key for the signature.  Raises StageError where it is too short to be one."""
    if not path.is_file():
        raise StageError(f"{path}: {absent(path)}; `openssl rand -hex 32 > {path}` makes a key")
    key = path.read_bytes().strip()
    if len(key) < SHORTEST_KEY:
        raise StageError(
            f"{path} has {len(key)} bytes; a key must have at least {SHORTEST_KEY}: `openssl rand -hex 32 > {path}`"
        )
    return key


def _canonical(content: dict[str, Any]) -> bytes:
    return json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()


def _hash(content: dict[str, Any]) -> str:
    return hashlib.sha256(_canonical(content)).hexdigest()


def _hmac(content: dict[str, Any], key: bytes) -> str:
    return hmac.new(key, _canonical(content), hashlib.sha256).hexdigest()
