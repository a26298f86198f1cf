"""Requests that say more than is read: refused, where an axis would move or get power by them."""

from __future__ import annotations

import asyncio

import pytest
from fastapi import Request

from stagectl.service.service import Service
from stagectl.units import StageError
from stagectl.web.bodies import check_no_body, wrong
from stagectl.web.http import application
from tests.web.conftest import answered


def _request(body: bytes) -> Request:
    async def receive() -> dict[str, object]:
        return {"type": "http.request", "body": body, "more_body": False}

    scope = {"type": "http", "method": "POST", "path": "/v1/enable", "query_string": b"", "headers": []}
    scope["server"] = ("localhost", 80)
    return Request(scope, receive)


@pytest.mark.parametrize("body", [b"", b"{}", b"null"])
def test_no_body_is_taken(body: bytes) -> None:
    asyncio.run(check_no_body(_request(body)))


def test_a_body_that_would_be_ignored_is_refused() -> None:
    with pytest.raises(StageError, match=r"/v1/enable takes no body, and nothing was done: name one axis as"):
        asyncio.run(check_no_body(_request(b'{"axis": "x"}')))


@pytest.mark.parametrize(
    ("method", "address", "code"),
    [
        ("GET", "/v1/recordings/recordings/axis/none.h5?as=mcap", 422),
        ("GET", "/v1/recordings/recordings/axis/none.h5?to=mcap", 404),
        ("POST", "/v1/enable?axes=x", 422),
        ("POST", "/v1/move?wait=false", 422),
        ("GET", "/v1/status?axis=x", 422),
        ("GET", "/v1/status", 200),
        ("GET", "/?axis=x", 200),
    ],
)
def test_what_an_address_says_and_nobody_reads_is_refused(
    service: Service, method: str, address: str, code: int
) -> None:
    assert answered(application(service), method, address).status == code


def test_no_word_behind_its_address_keeps_an_axis_from_stopping(service: Service) -> None:
    heeded: list[bool] = []
    service.axes["axis"].board.stop = lambda *_: heeded.append(True)  # type: ignore[method-assign]
    service.until = lambda *_: asyncio.sleep(0, True)  # type: ignore[method-assign]
    assert answered(application(service), "POST", "/v1/stop?axes=x", b"?").status == 200
    assert heeded


def test_a_download_is_named_after_its_machine_and_axis(service: Service) -> None:
    folder = service.paths.state / "recordings" / "axis"
    folder.mkdir(parents=True)
    (folder / "first one.h5").write_bytes(b"rows")
    answer = answered(application(service), "GET", "/v1/recordings/recordings/axis/first one.h5")
    assert (answer.status, answer.body) == (200, b"rows")
    named = 'attachment; filename="ball-screw-stage-A-axis-first one.h5"'
    assert answer.headers["content-disposition"] == named


@pytest.mark.parametrize(
    ("body", "kind", "error"),
    [
        (b'{"to": 5}', "application/json", 'body.to: must be an object, such as {"x": "5 mm"}'),
        (b'{"to": {"axis": 5}}', "application/json", "body.to.axis: must be text, a number with its unit in quotes"),
        (b'{"to": {"axis": "5 mm"}}', "application/x-www-form-urlencoded", "send the header Content-Type"),
    ],
)
def test_a_body_of_another_kind_says_what_it_must_be(service: Service, body: bytes, kind: str, error: str) -> None:
    headers = {"content_type": kind, "content_length": str(len(body))}
    answer = answered(application(service), "POST", "/v1/move", body, **headers)
    assert answer.status == 422 and error in answer.error


@pytest.mark.parametrize(
    ("body", "status", "key"),
    [
        (b'{"to": {"axis": "1 mm"}, "to": {"axis": "2 mm"}}', 422, '"to" twice'),
        (b'{"to": {"axis": "1 mm", "axis": "2 mm"}}', 422, '"axis" twice'),
        ('{"to": {"axis": "5 µm"}}'.encode("latin-1"), 400, "byte 19 on (0xb5): send UTF-8"),
    ],
)
def test_a_body_that_can_be_read_in_two_ways_moves_nothing(
    service: Service, body: bytes, status: int, key: str
) -> None:
    answer = answered(application(service), "POST", "/v1/move", body, content_type="application/json")
    assert answer.status == status and key in answer.error
    assert not answer.error.startswith(str(status))


def test_a_slash_at_the_end_is_another_path_and_says_which_is_meant(service: Service) -> None:
    answer = answered(application(service), "POST", "/v1/move/")
    assert answer.status == 404 and "did you mean /v1/move?" in answer.error


def test_an_entry_is_named_in_words() -> None:
    details = [{"loc": ("body", "position"), "type": "extra_forbidden", "msg": "Extra inputs are not permitted"}]
    assert wrong(details) == "body.position: is not known here; GET /openapi.json says what is"


@pytest.mark.parametrize(
    ("path", "body", "error"),
    [
        ("/v1/move", b'{"position": "5 mm"}', "position is not known here; known are to, by, speed"),
        ("/v1/recordings", b'{"for": 1}', "for is not known here; known are axis, name, before, seconds"),
        ("/v1/recordings", b'{"seconds": 0}', "body.seconds = 0: must be above 0"),
        ("/v1/recordings", b'{"before": 7200}', "body.before = 7200: must be at most 3600"),
        ("/v1/move", b'{"to": {}, "wait": "yes"}', "body.wait: must be true or false"),
        ("/v1/move", b'{"to": {"axis": "1 mm"}, "speed": ""}', "body.speed: must not be empty"),
        ("/v1/virtual/faults", b'{"parameters": {}}', "body.parameters: must be a list"),
        ("/v1/virtual/faults", b"{}", "body.fault"),  # an empty name ends all faults, none does nothing
        ("/v1/move", b"{targets: 5}", "body, character 2: "),
    ],
)
def test_a_body_that_is_wrong_says_what_is_admissible(service: Service, path: str, body: bytes, error: str) -> None:
    answer = answered(application(service), "POST", path, body, content_type="application/json")
    assert answer.status in (400, 422) and error in answer.error
