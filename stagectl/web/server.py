"""`stagectl serve`: the service, its sockets, and how they end together."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import uvicorn
import websockets  # noqa: F401  uvicorn imports it by name, and hides its absence

from stagectl.service import shutdown_signals
from stagectl.service.axis_controller import ServiceError
from stagectl.service.notify import notify
from stagectl.service.service import Service
from stagectl.web import assets
from stagectl.web.access_control import Guard, Keys, SameSite, secret
from stagectl.web.http import application
from stagectl.web.routes import Port

_AT_ONCE = 0.2  # s
_OWNERS = 0o660  # of the socket: who is neither its owner nor in its group cannot move anything


class Tcp(NamedTuple):
    """A TCP port in addition to the socket."""

    host: str
    port: int
    token: Path  # file with the token; made where there is none
    writes: bool
    virtual: bool = False  # nothing real can be moved: everybody at this terminal may know the key
    any_port: bool = False  # where this one is taken


class _Server(uvicorn.Server):
    """A server that leaves the signals to us."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave them alone."""
        yield


def run(service: Service, tcp: Tcp | None) -> None:
    """Serve until SIGTERM or SIGINT.

    Raises ServiceError where the real-time process does not stay alive, or a server ends by itself.
    """
    asyncio.run(_run(service, tcp))


async def _run(service: Service, tcp: Tcp | None) -> None:
    stopped = shutdown_signals.stop_event()
    listening = unix_socket(service.paths.socket)
    ports = [listening]
    keys, address = None, None
    if tcp is not None:
        keys = Keys(secret(tcp.token), secret(tcp.token.with_name("key")), tcp.writes)
        ports.append(_port(tcp))
        address = f"http://{tcp.host}:{ports[-1].getsockname()[1]}/"
    app = application(service, Port(address, keys.key) if keys else Port())
    servers = [(_server(SameSite(app, home=True)), [listening])]
    if keys is not None:
        servers.append((_server(SameSite(Guard(app, keys), home=False)), ports[1:]))
    if tcp is not None and keys is not None:
        service.say(f"live page: {address}#{keys.key}" if tcp.virtual else f"live page: {address} (`stagectl page`)")
        threading.Thread(target=_plots, args=(service.say,), daemon=True).start()
    try:
        if await _begun(service, stopped):
            await _until_stopped(service, servers, stopped)
    finally:
        notify("STOPPING=1")
        service.end()
        service.say("stopped: all processes have ended")
        for port in ports:
            port.close()
        service.paths.socket.unlink(missing_ok=True)


async def _begun(service: Service, stopped: asyncio.Event) -> bool:
    """Begin; False where a signal ended it meanwhile.  Raises ServiceError."""
    beginning, waiting = asyncio.create_task(service.begin()), asyncio.create_task(stopped.wait())
    await asyncio.wait([beginning, waiting], return_when=asyncio.FIRST_COMPLETED)
    if beginning.done() and beginning.exception():  # systemd signals all processes at once: a child may be the first
        await asyncio.wait([waiting], timeout=_AT_ONCE)
    waiting.cancel()
    if stopped.is_set():
        beginning.cancel()
        await asyncio.wait([beginning])
        return False
    await beginning
    return True


async def _until_stopped(
    service: Service, servers: list[tuple[_Server, list[socket.socket]]], stopped: asyncio.Event
) -> None:
    serving = [asyncio.create_task(server.serve(sockets=sockets)) for server, sockets in servers]
    watching, waiting = asyncio.create_task(service.watch()), asyncio.create_task(stopped.wait())
    notify("READY=1", f"STATUS={service.words()}")
    service.say(f"serving on {service.paths.socket}, process {os.getpid()}: {service.words()}")
    done, _ = await asyncio.wait([watching, waiting, *serving], return_when=asyncio.FIRST_COMPLETED)
    for server, _ in servers:
        server.should_exit = server.force_exit = True
    for task in (watching, waiting):
        task.cancel()
    await asyncio.gather(*serving, watching, waiting, return_exceptions=True)
    for ended in done:
        ended.result()
    if waiting not in done:
        raise ServiceError("a server of the service ended by itself: start the service again, and report this as a bug")


def _server(app: Any) -> _Server:
    config = uvicorn.Config(
        app,
        log_level="warning",
        lifespan="off",
        access_log=False,
        timeout_keep_alive=60,
        ws="websockets-sansio",
        ws_per_message_deflate=False,  # one small message each 16 ms: to compress it costs more than to send it
        ws_max_size=65536,
    )
    return _Server(config)


def _port(tcp: Tcp) -> socket.socket:
    """The listening port.  Raises ServiceError where another program has it."""
    try:
        return socket.create_server((tcp.host, tcp.port))
    except OSError as error:
        if tcp.any_port:
            return socket.create_server((tcp.host, 0))
        raise ServiceError(
            f"--tcp {tcp.host}:{tcp.port}: {error.strerror}; choose another port, or see which program uses it: "
            f"`ss -ltnp 'sport = {tcp.port}'`"
        ) from error


def _plots(say: Callable[[str], None]) -> None:
    """The page's plots, once, where the build could not bring them."""
    if assets.available() is None:
        try:
            assets.fetch(assets.cache())
        except assets.AssetError as error:
            say(f"the live page has no plots: {error}; the rest of it works")


def unix_socket(path: Path) -> socket.socket:
    """The control socket, with the permissions that decide who may move the axis.

    Raises ServiceError where another service listens on it.
    """
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o755)
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.connect(os.fspath(path))
        raise ServiceError(f"a service listens on {path} already: stop it first, or choose another --socket")
    path.unlink(missing_ok=True)
    before = os.umask(0o777 & ~_OWNERS)
    try:
        listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        listening.bind(os.fspath(path))
    except OSError as error:
        raise ServiceError(f"{path}: {error.strerror}; choose another --socket") from error
    finally:
        os.umask(before)
    listening.listen(128)
    return listening
