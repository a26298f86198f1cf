"""`stagectl serve`: the service, its sockets, and how they end together."""

import asyncio
import contextlib
import errno
import os
import resource
import socket
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import uvicorn
import websockets  # noqa: F401  uvicorn imports it by name, and hides its absence

from stagectl.service import shutdown_signals
from stagectl.service.axis_controller import ServiceError
from stagectl.service.limits import AT_ONCE, BACKLOG, DESCRIPTORS, IDLE_TIME
from stagectl.service.service import LOOK, Service
from stagectl.service.single_instance import handed_over, notify, serving
from stagectl.web import assets
from stagectl.web.access_control import Check, Keys, at_home, by_key, guarded, same_site, secret
from stagectl.web.bodies import Bodies
from stagectl.web.http import application
from stagectl.web.limits import MESSAGE
from stagectl.web.routes import Port
from stagectl.web.seats import Guest, Live, Seats, seated


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
    _reserve_descriptors(service.say)
    with contextlib.ExitStack() as ends:
        last = ends.enter_context(contextlib.ExitStack())
        servers = _servers(service, tcp, ends)
        last.callback(service.say, "stopped: all processes have ended")
        ends.callback(service.end)
        ends.callback(notify, "STOPPING=1")
        if await _begun(service, stopped):
            await _until_stopped(service, servers, stopped)


def _servers(
    service: Service, tcp: Tcp | None, ends: contextlib.ExitStack
) -> list[tuple[_Server, list[socket.socket]]]:
    """The servers with their listening sockets, which `ends` closes."""
    listening = ends.enter_context(serving(service.paths.socket, socket.SOCK_STREAM))
    if tcp is None:
        return [(_server(Bodies(application(service)), at_home(seated), home=True), [listening])]
    keys, port = Keys(secret(tcp.token), secret(tcp.token.with_name("key")), tcp.writes), _port(tcp)
    ends.callback(port.close)
    address = f"http://{tcp.host}:{port.getsockname()[1]}/"
    service.say(f"live page: {address}#{keys.key}" if tcp.virtual else f"live page: {address} (`stagectl page`)")
    threading.Thread(target=_plots, args=(service.say,), daemon=True).start()
    app = Bodies(application(service, Port(address, keys.key)))
    return [
        (_server(app, at_home(seated), home=True), [listening]),
        (_server(app, by_key(keys, seated), home=False), [port]),
    ]


def _reserve_descriptors(say: Callable[[str], None]) -> None:
    """Make sure that all seats together leave descriptors for what the service itself needs."""
    now, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if now < DESCRIPTORS:
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(DESCRIPTORS, most), most))
    if most < DESCRIPTORS:
        say(f"only {most} files may be open: clients could take them all; allow {DESCRIPTORS} with LimitNOFILE=")


async def _begun(service: Service, stopped: asyncio.Event) -> bool:
    """Begin; False where a signal ended it meanwhile.  Raises ServiceError."""
    waiting = asyncio.create_task(stopped.wait())
    if (await asyncio.wait([waiting], timeout=LOOK))[0]:  # a signal that came while the service was being loaded
        return False
    beginning = asyncio.create_task(service.begin())
    await asyncio.wait([beginning, waiting], return_when=asyncio.FIRST_COMPLETED)
    if beginning.done() and beginning.exception():  # systemd signals all processes at once: a child may be the first
        await asyncio.wait([waiting], timeout=AT_ONCE)
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


def _server(app: Any, check: Check, home: bool) -> _Server:
    config = uvicorn.Config(
        guarded(app, same_site(home), check),
        http=partial(Guest, Seats()),  # type: ignore[arg-type]
        backlog=BACKLOG,
        log_level="warning",
        lifespan="off",
        access_log=False,
        timeout_keep_alive=round(IDLE_TIME),
        ws=Live,
        ws_per_message_deflate=False,  # one small message each 16 ms: to compress it costs more than to send it
        ws_max_size=MESSAGE,
    )
    return _Server(config)


def _port(tcp: Tcp) -> socket.socket:
    """The listening port, as systemd opened it or our own.  Raises ServiceError where another program has it."""
    if (listening := handed_over()) is not None:
        return listening
    try:
        return socket.create_server((tcp.host, tcp.port))
    except OSError as error:
        if tcp.any_port:
            return socket.create_server((tcp.host, 0))
        raise ServiceError(f"--tcp {tcp.host}:{tcp.port}: {_why_not(tcp, error)}") from error


def _why_not(tcp: Tcp, error: OSError) -> str:
    """Why nobody can listen there, and what to do."""
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return f"{tcp.host} is no address of this computer: see `ip -brief address`"
    if error.errno == errno.EACCES:
        return f"{error.strerror}; choose a port from 1024 on"
    words = f"{error.strerror}; choose another port, or see which program uses it"
    return f"{words}: `ss -ltnp 'sport = {tcp.port}'`"


def _plots(say: Callable[[str], None]) -> None:
    """The page's plots, once, where the build could not bring them."""
    if assets.available() is None:
        try:
            assets.fetch(assets.cache())
        except assets.AssetError as error:
            say(f"the live page has no plots: {error}; the rest of it works")
