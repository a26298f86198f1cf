"""The lock of the folder of a machine: free, or kept by another service, which is named."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

import pytest

from stagectl.service import single_instance
from stagectl.service.axis_controller import ServiceError


async def locked(state: Path, ends: contextlib.ExitStack, said: list[str]) -> int:
    return await single_instance.take_lock(state, ends, said.append)


def test_a_folder_in_use_is_waited_for_in_plain_sight_then_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(single_instance, "_LOCK", 0.2)
    said: list[str] = []
    with contextlib.ExitStack() as first, contextlib.ExitStack() as second:
        asyncio.run(locked(tmp_path, first, said))
        single_instance.mark_running(tmp_path, first)
        assert not said
        with pytest.raises(ServiceError) as error:
            asyncio.run(locked(tmp_path, second, said))
        process = (tmp_path / "running").read_text()
    assert [process in words and str(tmp_path) in words for words in (*said, str(error.value))] == [True, True]


def test_a_folder_whose_service_ends_meanwhile_is_taken(tmp_path: Path) -> None:
    said: list[str] = []

    async def handed_over(first: contextlib.ExitStack, second: contextlib.ExitStack) -> int:
        await locked(tmp_path, first, said)
        waiting = asyncio.create_task(locked(tmp_path, second, said))
        while not said:
            await asyncio.sleep(0)
        first.close()
        return await waiting

    with contextlib.ExitStack() as first, contextlib.ExitStack() as second:
        assert asyncio.run(handed_over(first, second)) > 0
    assert len(said) == 1 and "unknown" in said[0]  # it left no mark
