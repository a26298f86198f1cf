"""Requests that say more than is read: refused, where an axis would move or get power by them."""

from __future__ import annotations

import asyncio

import pytest
from fastapi import Request

from stagectl.units import StageError
from stagectl.web.bodies import check_exact, wrong


def _request(query: bytes, body: bytes) -> Request:
    async def receive() -> dict[str, object]:
        return {"type": "http.request", "body": body, "more_body": False}

    scope = {"type": "http", "method": "POST", "path": "/v1/enable", "query_string": query, "headers": []}
    scope["server"] = ("localhost", 80)
    return Request(scope, receive)


@pytest.mark.parametrize(("query", "body"), [(b"", b""), (b"axis=x", b""), (b"", b"{}"), (b"axis=x", b"null")])
def test_what_is_read_is_taken(query: bytes, body: bytes) -> None:
    asyncio.run(check_exact(_request(query, body), ("axis",)))


@pytest.mark.parametrize(
    ("query", "body", "words"),
    [(b"", b'{"axis": "x"}', "takes no body"), (b"axes=x", b"", "takes no axes in the address")],
)
def test_what_would_be_ignored_is_refused(query: bytes, body: bytes, words: str) -> None:
    with pytest.raises(StageError, match=f"/v1/enable {words}, and nothing was done: name one axis as"):
        asyncio.run(check_exact(_request(query, body), ("axis",)))


def test_an_entry_is_named_in_words() -> None:
    details = [{"loc": ("body", "position"), "type": "extra_forbidden", "msg": "Extra inputs are not permitted"}]
    assert wrong(details) == "body.position: is not known here; GET /openapi.json says what is"
