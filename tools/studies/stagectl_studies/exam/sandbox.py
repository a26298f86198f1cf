"""A command of stagectl that may read its own folder and what every program needs, and nothing else.

    python -m stagectl_studies.exam.sandbox LOG --own DIR --out DIR --closed DIR -- gap diagnose FOLDER ...

An audit hook (PEP 578) sees each file that is opened, moved, linked or removed, each folder that is listed, each
process and connection that is begun.  `own` may be read, `out` and the caches of libraries read and written; `closed`,
the exam's code and other processes may not, whatever else is allowed.  What is forbidden is written to LOG and refused;
a LOG with a line in it makes the trial void.  Files that a compiled library opens by itself are not seen: that is why
the labels lie enciphered.
"""

import argparse
import importlib
import os
import platform
import runpy
import signal
import site
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import stagectl
import stagectl_studies

SYSTEM = ("/usr", "/lib", "/lib64", "/bin", "/etc", "/dev", "/sys", "/opt", "/var/cache/fontconfig")
PROC = ("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/sys", "/proc/version", "/proc/filesystems")
READ = {"open": (0,), "os.listdir": (0,), "os.scandir": (0,)}  # event -> places of paths among its arguments
WRITTEN = {"os.rename": (0, 1), "os.link": (0, 1), "os.symlink": (0, 1), "os.remove": (0,), "os.truncate": (0,)}
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
REFUSED = ("socket.connect", "socket.sendto", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.system", "os.fork")
OUT_OF_MEMORY = 75  # exit code: not the program's fault, to be tried again
_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG


class Rules(NamedTuple):
    """Folders by what may be done with them; the first that holds a path decides, in this order."""

    own: tuple[str, ...]  # read
    out: tuple[str, ...]  # written, too
    closed: tuple[str, ...]
    known: tuple[str, ...]
    itself: tuple[str, ...] = ()  # folders where modules are looked for, nothing below; this file, for tracebacks


def caches() -> tuple[str, ...]:
    """Where libraries keep what they have made, and devices: written by whoever runs."""
    chosen = [os.environ.get("XDG_CACHE_HOME"), os.environ.get("NUMBA_CACHE_DIR"), os.environ.get("MPLCONFIGDIR")]
    folders = (str(Path.home() / ".cache"), str(Path.home() / ".config"), *filter(None, chosen), "/dev")
    return tuple(dict.fromkeys(os.path.realpath(folder) for folder in folders))


def known_folders() -> tuple[str, ...]:
    """Where interpreter, libraries and this package lie."""
    packages = (Path(file).resolve().parent for file in (stagectl.__file__, stagectl_studies.__file__))
    libraries = [*sysconfig.get_paths().values(), *site.getsitepackages(), sys.prefix, sys.base_prefix]
    return tuple(dict.fromkeys(os.path.realpath(path) for path in (*map(str, packages), *libraries, *SYSTEM))) + PROC


def rules(own: Sequence[str], out: Sequence[str], closed: Sequence[str]) -> Rules:
    """The rules of one diagnosis; the exam's own code is closed to it."""
    code = [str(Path(stagectl_studies.__file__).resolve().parent / room) for room in ("exam", "machine")]
    mine, writable = (tuple(os.path.realpath(place) for place in each) for each in (own, out))
    path = tuple(os.path.realpath(place) for place in (*sys.path, __file__))
    known = (*known_folders(), *_metadata(path))
    shut = (*(os.path.realpath(place) for place in closed), *code)
    return Rules(mine, (*writable, *caches()), shut, known, path)


def _metadata(path: Sequence[str]) -> list[str]:
    """What packages say of themselves, where libraries look for plug-ins; an editable install has it in its tree."""
    return [
        str(metadata) for place in path for kind in ("*.dist-info", "*.egg-info") for metadata in Path(place).glob(kind)
    ]


def inside(path: str, folders: Sequence[str]) -> bool:
    """Whether a path is one of the folders or lies below it."""
    return any(path == folder or path.startswith(folder.rstrip("/") + "/") for folder in folders)


def allowed(path: str, p: Rules, writing: bool = False) -> bool:
    """Whether a path may be opened; what does not exist tells nothing, and may be looked for."""
    if path.startswith("/proc/") and path.split("/")[2] == str(os.getpid()):
        return True
    if inside(path, p.out) or writing:
        return inside(path, p.out)
    if inside(path, p.own) or path in p.itself:
        return True
    return not inside(path, p.closed) and (inside(path, p.known) or not os.path.lexists(path))


def hook(p: Rules, report: Callable[[str], None]) -> Callable[[str, tuple[Any, ...]], None]:
    """The audit hook of a diagnosis under these rules."""

    def audit(event: str, arguments: tuple[Any, ...]) -> None:
        if event in REFUSED:
            words = f"{event} {arguments[0] if event != 'socket.connect' else arguments[1]}"
        elif wrong := _forbidden(p, event, arguments):
            words = f"{event} {wrong}"
        else:
            return
        report(words)
        raise PermissionError(f"not allowed in an exam: {words}")

    return audit


def _forbidden(p: Rules, event: str, arguments: tuple[Any, ...]) -> str:
    """The first path of an event that may not be touched so; empty where there is none."""
    writing = event in WRITTEN or (event == "open" and isinstance(arguments[2], int) and bool(arguments[2] & _WRITING))
    given = [arguments[place] for place in (READ | WRITTEN).get(event, ())]
    named = [path for path in given if isinstance(path, (str, bytes, os.PathLike))]
    paths = [os.path.realpath(os.fsdecode(entry)) for entry in named]
    return next((path for path in paths if not allowed(path, p, writing)), "")


def main(arguments: Sequence[str]) -> None:
    """Run a command of stagectl under the hook."""
    parser = argparse.ArgumentParser(prog="watched", description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--own", action="append", default=[])
    parser.add_argument("--out", action="append", default=[])
    parser.add_argument("--closed", action="append", default=[])
    parser.add_argument("--module", default="stagectl")
    parser.add_argument("--parent", type=int, help="process that this one ends with")
    split = list(arguments).index("--")
    given, command = parser.parse_args(arguments[:split]), arguments[split + 1 :]
    die_with(given.parent)
    _end_by_interrupt()
    log = os.open(given.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    tempfile.gettempdir()  # tries itself in a folder
    platform.uname().processor  # noqa: B018  asks another process, once
    importlib.import_module("matplotlib.font_manager")  # asks another process for the fonts, once on a machine
    sys.argv = [given.module, *command]
    sys.addaudithook(hook(rules(given.own, given.out, given.closed), lambda words: _written(log, words)))
    try:
        runpy.run_module(given.module, run_name="__main__", alter_sys=True)
    except MemoryError:
        print("out of memory", file=sys.stderr)
        raise SystemExit(OUT_OF_MEMORY) from None


def die_with(parent: int | None) -> None:
    """The kernel ends this process with the one that began it (Linux): no answer comes in after a killed trial."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if parent is not None and os.getppid() != parent:  # it was quicker
            os.kill(os.getpid(), signal.SIGKILL)


def _end_by_interrupt() -> None:
    """Ctrl-C ends this process by its signal, which no exit code of the program hides; ignored, it stays ignored."""
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def _written(log: int, words: str) -> None:
    os.write(log, (words.replace("\n", " ") + "\n").encode())


if __name__ == "__main__":
    main(sys.argv[1:])
