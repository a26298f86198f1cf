"""The guest's runs: booted once and frozen; each run of the tests goes on from there.

The checkout goes in as a tar file on a disk, the results come out of another.
"""

import compileall
import io
import resource
import socket
import subprocess
import sys
import tarfile
import tempfile
import threading
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CHECKOUT = ("stagectl", "config", "systemd", "pyproject.toml", "README.md", "tests/__init__.py", "tests/vm")
DISKS = 64 << 20  # bytes of the checkout's disk and of the results'
PASSED, FAILED = 1, 3  # QEMU's exit codes where the guest wrote 0 and 1 to the debug port
READY = "guest: ready"
FROZEN = "frozen"
GUEST = "cpython-311"  # whose byte code goes along, so that the guest need not compile

# Time is counted in instructions, one a nanosecond: the guest is as fast on a busy host as on an idle one, and a
# guest that waits skips to the next deadline.  No figure of time from in here is one of real hardware.
QEMU = (
    "qemu-system-x86_64 -accel tcg,thread=single -icount shift=0,sleep=off -cpu max -smp 1 -m 1536M -nodefaults"
    " -no-user-config -display none -no-reboot -rtc clock=vm"
    " -device isa-debug-exit,iobase=0xf4,iosize=0x4 -serial stdio"
    " -global migration.store-global-state=off"  # that it was stopped: it goes on by itself
)
KERNEL = (
    "console=ttyS0 rw quiet loglevel=4 panic=-1 mitigations=off audit=0 selinux=0 apparmor=0 cryptomgr.notests"
    " systemd.show_status=0"
)


class Ended(NamedTuple):
    """How a run went."""

    passed: bool
    why: str  # of a failure
    results: Path | None


class LateError(Exception):
    """The guest took longer than it may; the message says at what."""


class StarvedError(Exception):
    """It took longer because the host gave it little time: nothing is known."""


def boot(image: Path, patience: float) -> None:
    """Boot the guest and freeze it in front of an empty disk.  Raises LateError, StarvedError after `patience` (s)."""
    with tempfile.TemporaryDirectory(dir=image) as folder:
        monitor, file = Path(folder) / "monitor", Path(folder) / FROZEN
        command = [*_command(image, _disks(Path(folder))), "-monitor", f"unix:{monitor},server=on,wait=off"]
        guest = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, errors="replace")
        alarm = threading.Timer(patience, guest.kill)
        alarm.start()
        said = _heard(guest)
        if READY not in said:
            alarm.cancel()
            guest.kill()
            guest.wait()
            _starved(patience)
            raise LateError(f"the guest did not boot within {patience:.0f} s: {said[-800:]}")
        # Stopped first: of a guest that runs on, QEMU may miss a page that is written in that moment.
        _tell(monitor, ("stop", f'migrate "exec:cat > {file}"', "quit"))
        guest.wait()
        alarm.cancel()
        if not file.exists() or file.stat().st_size == 0:
            raise LateError("the guest could not be frozen")
        file.rename(image / FROZEN)


def run(image: Path, arguments: list[str], patience: float, results: Path) -> Ended:
    """Run pytest with these arguments in the frozen guest, at most `patience` (s) of the host's time.

    Raises StarvedError.
    """
    with tempfile.TemporaryDirectory() as folder:
        disks = _disks(Path(folder))
        _pack(disks[0], arguments)
        command = [*_command(image, disks), "-monitor", "none", "-incoming", f"exec:cat {image / FROZEN}"]
        try:
            code = subprocess.run(command, check=False, stdin=subprocess.DEVNULL, timeout=patience).returncode
        except subprocess.TimeoutExpired:
            _starved(patience)
            return Ended(False, f"the guest did not end within {patience:.0f} s", None)
        unpacked = _unpack(disks[1], results)
    own = f"the guest ended by itself (QEMU's exit code {code})"
    return Ended(code == PASSED, {PASSED: "", FAILED: "tests failed in the guest"}.get(code, own), unpacked)


def _starved(patience: float) -> None:
    """Raise StarvedError where the processes that have ended had less than half of a processor."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    had = used.ru_utime + used.ru_stime
    if had < 0.5 * patience:
        raise StarvedError(f"in {patience:.0f} s this host gave the guest {had:.0f} s of a processor")


def _heard(guest: subprocess.Popen[str]) -> str:
    """What it says on its console until it is ready or ends."""
    said: list[str] = []
    assert guest.stdout is not None
    for line in guest.stdout:
        said.append(line)
        if READY in line:
            break
    return "".join(said)


def _tell(monitor: Path, commands: tuple[str, ...]) -> None:
    """Commands to QEMU's monitor, each heard out: QEMU forgets what it has not read from a link that is closed."""
    with socket.socket(socket.AF_UNIX) as link:
        link.connect(str(monitor))
        _prompted(link)
        for command in commands:
            link.sendall(f"{command}\n".encode())
            _prompted(link)


def _prompted(link: socket.socket) -> None:
    """Wait for the monitor's prompt, or its end."""
    heard = b"."
    while heard and not heard.rstrip().endswith(b"(qemu)"):
        heard = link.recv(4096)


def _disks(folder: Path) -> tuple[Path, Path]:
    """Two empty ones, of the size that the frozen guest knows."""
    disks = folder / "checkout.tar", folder / "results.tar"
    for disk in disks:
        with disk.open("wb") as file:
            file.truncate(DISKS)
    return disks


def _command(image: Path, disks: tuple[Path, Path]) -> list[str]:
    command = [*QEMU.split(), "-kernel", str(image / "vmlinuz"), "-initrd", str(image / "initrd.gz"), "-append", KERNEL]
    for path, how in ((image / "root.img", ",snapshot=on"), (disks[0], ",snapshot=on"), (disks[1], "")):
        command += ["-drive", f"file={path},if=virtio,format=raw{how}"]
    return command


def _pack(disk: Path, arguments: list[str]) -> None:
    """The working tree as it is, with what the guest shall do; of one tree always the same bytes."""
    compiled = _compiled()
    with disk.open("r+b") as file, tarfile.open(fileobj=file, mode="w") as tar:
        _add(tar, "guest.sh", (HERE / "guest.sh").read_bytes())
        _add(tar, "arguments", "\n".join(arguments).encode())
        for name in CHECKOUT:
            for path in sorted([ROOT / name, *(ROOT / name).rglob("*")]):
                content = path.read_bytes() if path.is_file() else b""
                if path in compiled and GUEST in path.name:
                    _add(tar, str(path.relative_to(ROOT)), _trusted(content))
                elif path.is_file() and path.suffix != ".pyc":
                    _add(tar, str(path.relative_to(ROOT)), content)


def _compiled() -> set[Path]:
    """Byte code that is up to date; none where this Python is not the guest's."""
    if sys.implementation.cache_tag != GUEST:
        return set()
    compileall.compile_dir(ROOT / "stagectl", quiet=2)
    return set((ROOT / "stagectl").rglob("*.pyc"))


def _trusted(code: bytes) -> bytes:
    """Byte code that is taken without a look at the time of its source (PEP 552: unchecked, with any hash)."""
    return code[:4] + b"\x01\0\0\0" + bytes(8) + code[16:]


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = len(content), 0o644
    tar.addfile(entry, io.BytesIO(content))


def _unpack(disk: Path, results: Path) -> Path | None:
    try:
        with tarfile.open(disk) as tar:
            tar.extractall(results, filter="data")
    except tarfile.TarError:
        print("the guest handed out no results", file=sys.stderr)
        return None
    return results
