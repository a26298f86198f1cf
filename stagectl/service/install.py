"""Install and remove the systemd service: the files, and the commands that activate them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Canopen
from stagectl.units import StageError

_SYSTEMD = Path("/run/systemd/system")  # there while it runs
QUEUE = 128  # frames in the interface's queue: ten cycles and more
_IN_WHEEL = Path(__file__).parent / "units"  # copied there from systemd/ when the wheel is built
UNIT, SOCKET, USERS, RULES = "stagectl.service", "stagectl.socket", "stagectl.sysusers", "80-stagectl.rules"
NETWORK, LINK = "80-stagectl-can.network", "80-stagectl-can.link"
PLACES = {
    UNIT: "etc/systemd/system/stagectl.service",
    SOCKET: "etc/systemd/system/stagectl.socket",
    USERS: "etc/sysusers.d/stagectl.conf",
    RULES: "etc/udev/rules.d/80-stagectl.rules",
    NETWORK: "etc/systemd/network/80-stagectl-can.network",
    LINK: "etc/systemd/network/80-stagectl-can.link",
}


class InstallError(StageError):
    """A file could not be installed or removed."""


class Step(NamedTuple):
    """What was done, in words, and whether it succeeded."""

    words: str
    good: bool = True


class Installation(NamedTuple):
    """The machine that the service runs, and how."""

    stages: tuple[tuple[str, Path, Setup], ...]  # name, file, set-up
    python: Path
    tcp: tuple[str, int] | None = None  # host and port
    coupled: bool = True  # a fault of one axis stops all


def contents(installation: Installation) -> dict[str, str]:
    """The files by their place below the root."""
    templates = _IN_WHEEL if _IN_WHEEL.is_dir() else Path(__file__).parents[2] / "systemd"
    texts = {name: (templates / name).read_text(encoding="utf-8") for name in PLACES}
    wanted = (UNIT, USERS, RULES, *([SOCKET] if installation.tcp else []))
    files = {PLACES[name]: _filled(texts[name], _unit(installation)) for name in wanted}
    wire = _socketcan(installation)
    if wire is not None:
        values = {"CHANNEL": wire.channel, "BITRATE": f"{wire.bitrate:.0f}", "QUEUE": str(QUEUE)}
        files |= {PLACES[name]: _filled(texts[name], values) for name in (NETWORK, LINK)}
    return files


def _filled(text: str, values: dict[str, str]) -> str:
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text


def _socketcan(installation: Installation) -> Canopen | None:
    wires = (setup.file.drive.wire for _, _, setup in installation.stages)
    return next((wire for wire in wires if isinstance(wire, Canopen) and wire.interface == "socketcan"), None)


def _unit(installation: Installation) -> dict[str, str]:
    wire, cpu = _socketcan(installation), installation.stages[0][2].file.realtime.cpu
    single = len(installation.stages) == 1
    stages = " ".join(f'"{path}"' if single else f'"{name}={path}"' for name, path, _ in installation.stages)
    stages += "" if installation.coupled else " --uncoupled"
    paths = (installation.python, *(path for _, path, _ in installation.stages))
    home = any(path.absolute().parts[1:2] in (("home",), ("root",)) for path in paths)
    families = ["AF_UNIX", "AF_NETLINK", *(["AF_CAN"] if wire else [])]  # none for TCP: systemd opens that port
    listening = "{}:{}".format(*installation.tcp) if installation.tcp else ""
    return {
        "NAME": ", ".join(setup.file.name for _, _, setup in installation.stages),
        "README": str(Path(__file__).parents[2] / "README.md"),
        "AFTER": _after(wire, bool(listening)),
        "PYTHON": str(installation.python),
        "STAGES": stages + (f" --tcp {listening}" if listening else ""),
        "AFFINITY": ""
        if cpu is None
        else f"# The loop pins itself to CPU {cpu}; the rest of the service stays off it.",
        "HOME": "read-only" if home else "yes",
        # A user namespace takes the real-time rights away: SCHED_FIFO needs the first one.
        "USERS": "no",
        "FAMILIES": " ".join(families),
        "ADDRESS": listening.replace("localhost:", "127.0.0.1:"),
        "NETWORK": _reachable(installation.tcp[0] if installation.tcp else ""),
    }


def _after(wire: Canopen | None, tcp: bool) -> str:
    """What must be there before the service starts."""
    device = f"sys-subsystem-net-devices-{wire.channel}.device" if wire else ""
    lines = [f"BindsTo={device}", f"After={device} systemd-networkd.service"] if wire else ["After=local-fs.target"]
    return "\n".join([*lines, *([f"Requires={SOCKET}", f"After={SOCKET}"] if tcp else [])])


def _reachable(host: str) -> str:
    """Whom the service may talk to over IP: nobody, this machine, or anybody, by the `host` that it listens on."""
    return "" if not host else "localhost" if host in ("127.0.0.1", "localhost", "[::1]") else "any"


def install(installation: Installation, root: Path, start: bool) -> list[Step]:
    """Write all files below `root` and activate them.

    Raises InstallError where that is not permitted.
    """
    if start and root == Path("/") and not _SYSTEMD.is_dir():
        raise InstallError("systemd does not run this computer, and nothing was written: use `stagectl serve` here")
    done = []
    for place, text in contents(installation).items():
        path = root / place
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise InstallError(
                f"{path}: {error.strerror}; run this as root: sudo stagectl service install ..."
            ) from error
        done.append(Step(f"wrote {path}"))
    return done + _run(_known(_socketcan(installation), start), root)


def remove(root: Path) -> list[Step]:
    """Stop the service and remove what `install` wrote; recordings, black boxes and their user stay.

    Raises InstallError where that is not permitted, or no systemd is there to start it.
    """
    done = _run([["systemctl", "disable", "--now", UNIT]] if (root / PLACES[UNIT]).exists() else [], root)
    for place in PLACES.values():
        path = root / place
        try:
            path.unlink()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise InstallError(f"{path}: {error.strerror}; run this as root: sudo stagectl service remove") from error
        done.append(Step(f"removed {path}"))
    return done + _run([["systemctl", "daemon-reload"], ["udevadm", "control", "--reload"]], root)


def _known(wire: Canopen | None, start: bool) -> list[list[str]]:
    commands = [
        ["systemd-sysusers"],
        ["udevadm", "control", "--reload"],
        ["udevadm", "trigger", "--settle", "--name-match=cpu_dma_latency"],
        ["systemctl", "daemon-reload"],
    ]
    if wire is not None:  # an interface that is there already has been set up without these files
        path = f"/sys/class/net/{wire.channel}"
        commands += [["networkctl", "reload"], ["udevadm", "trigger", "--settle", "--action=add", path]]
    return [*commands, ["systemctl", "enable", *(["--now"] if start else []), UNIT]]


def _run(commands: list[list[str]], root: Path) -> list[Step]:
    """Run `commands` where `root` is the root of this machine."""
    if root != Path("/"):
        return [Step(f"not run, {root} is not the root of this machine: {' '.join(command)}") for command in commands]
    report = []
    for command in commands:
        line = " ".join(command)
        if shutil.which(command[0]) is None:
            report.append(Step(f"not run, {command[0]} is not installed: {line}", good=False))
            continue
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        failed = f"failed: {line}: {ended.stderr.strip()}"
        report.append(Step(failed, good=False) if ended.returncode else Step(line))
    return report


def interpreter() -> Path:
    """The Python that runs this, by the path that its environment is found by."""
    return Path(os.path.abspath(sys.executable))
