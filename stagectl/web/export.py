"""A recording on its way to a browser; another process writes other formats."""

from __future__ import annotations

import asyncio
import os
import sys
import tempfile
from pathlib import Path

from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from stagectl.service.axis_controller import ServiceError


async def exported(path: Path, to: str) -> FileResponse:
    """The file, or what `stagectl export` makes of it.

    Raises ServiceError with the export's reason.
    """
    if to == "h5":
        return FileResponse(path, filename=path.name)
    descriptor, name = tempfile.mkstemp(suffix=f".{to}", prefix="stagectl-")
    os.close(descriptor)
    command = [sys.executable, "-P", "-m", "stagectl", "export", str(path), "--to", to, "-o", name]
    process = await asyncio.create_subprocess_exec(*command, stderr=asyncio.subprocess.PIPE)
    _, errors = await process.communicate()
    if process.returncode:
        os.unlink(name)
        raise ServiceError(errors.decode(errors="replace").strip().removeprefix("error: "))
    return FileResponse(name, filename=f"{path.stem}.{to}", background=BackgroundTask(os.unlink, name))
