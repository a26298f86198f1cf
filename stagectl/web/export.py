"""A recording on its way to a client; for other formats another process writes it, into a file without a name.

One export at a time, and few that wait or are being fetched.  Its process is killed when the client goes, and the file
goes with its last descriptor: nothing can be left behind.
"""

import asyncio
import contextlib
import os
import re
import sys
import tempfile
import unicodedata
from collections.abc import AsyncIterator
from pathlib import Path
from typing import IO

from fastapi.responses import FileResponse
from starlette.responses import Response, StreamingResponse

from stagectl.service.axis_controller import ServiceError
from stagectl.service.child_process import PYTHON, environment
from stagectl.service.limits import EXPORT_TIME, EXPORTS_WAITING, FETCH_TIME
from stagectl.web.limits import BLOCK


class Exports:
    """The exports of one service."""

    def __init__(self) -> None:
        self._turn, self._going = asyncio.Lock(), 0

    async def file(self, path: Path, to: str, machine: str) -> Response:
        """The file, or what `stagectl export` makes of it, under a name that tells of which `machine` and axis it is.

        Raises ServiceError with the export's reason, and where too many are wanted.
        """
        parts = (*map(_plain, (machine, path.parent.name)), f"{path.stem}.{to}")
        named = {"Content-Disposition": f'attachment; filename="{"-".join(filter(None, parts))}"'}
        if to == "h5":
            return FileResponse(path, headers=named)
        if self._going >= EXPORTS_WAITING:
            raise ServiceError(f"{EXPORTS_WAITING} exports are going on: try again when they have ended")
        self._going += 1
        try:
            async with self._turn:
                file = await _exported(path, to)
        except BaseException:
            self._going -= 1
            raise
        size = os.fstat(file.fileno()).st_size
        headers = {**named, "Content-Length": str(size)}
        return _Fetched(self._sent(file, size), headers=headers, media_type="application/octet-stream")

    async def _sent(self, file: IO[bytes], size: int) -> AsyncIterator[bytes]:
        try:
            async with asyncio.timeout(FETCH_TIME):
                for _ in range(0, size, BLOCK):
                    yield await asyncio.to_thread(file.read, BLOCK)
        finally:
            file.close()
            self._going -= 1


def _plain(name: str) -> str:
    """A name as a part of a file's name that every program takes."""
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9]+", "-", letters).strip("-")


class _Fetched(StreamingResponse):
    """A file whose iterator is closed when its client goes, and not when it is collected."""

    body_iterator: AsyncIterator[bytes]

    async def __call__(self, scope: object, receive: object, send: object) -> None:
        try:
            await super().__call__(scope, receive, send)  # type: ignore[arg-type]
        finally:
            await self.body_iterator.aclose()  # type: ignore[attr-defined]


async def _exported(path: Path, to: str) -> IO[bytes]:
    """The exported file, open and without a name.  Raises ServiceError."""
    with tempfile.TemporaryDirectory(prefix="stagectl-export-") as folder:
        target = Path(folder) / f"export.{to}"
        await _written(path, to, target)
        return target.open("rb")


async def _written(path: Path, to: str, target: Path) -> None:
    """Have another process write it; it is killed where it takes too long, or nobody waits any more."""
    process = await asyncio.create_subprocess_exec(
        *PYTHON,
        "-m",
        "stagectl.web.export_process",
        *map(str, (path, to, target)),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        env=environment(OPENBLAS_NUM_THREADS="1"),
    )
    try:
        _, errors = await asyncio.wait_for(process.communicate(), EXPORT_TIME)
    except TimeoutError as error:
        raise ServiceError(f"the export took longer than {EXPORT_TIME:g} s: copy the .h5 and export that") from error
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    if process.returncode:
        sys.stderr.buffer.write(errors)
        words = errors.decode(errors="replace").strip().splitlines()[-1:] or [
            f"its process ended ({process.returncode})"
        ]
        raise ServiceError(f"the export failed: {words[0]}")
