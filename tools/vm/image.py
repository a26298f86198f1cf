"""The guest's disk, kernel and initial RAM disk: built once, kept outside the checkout under their recipe's hash."""

import gzip
import hashlib
import lzma
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import needs

HERE = Path(__file__).parent
RECIPE = ("image.py", "init", "waiting.sh", "requirements.txt")
FILES = ("vmlinuz", "initrd.gz", "root.img")
SUITE, PYTHON = "bookworm", "3.11"
PACKAGES = "systemd,systemd-sysv,udev,dbus,python3,iproute2,kmod,can-utils,procps,rt-tests"
FIRST = ("virtio_pci", "virtio_blk", "crc32c_generic", "ext4", "overlay")  # to reach the disk
LATER = ("can", "can-raw", "can-bcm", "vcan", "slcan", "autofs4")
SIZE = "1200M"
_SITE = f"usr/local/lib/python{PYTHON}/dist-packages"

# What the guest is, besides Debian: one virtual CAN interface, the tests as a service, the checkout on Python's path.
TEXTS = {
    f"{_SITE}/stagectl.pth": "/srv/stagectl\n",
    "etc/fstab": "",
    "etc/hostname": "guest\n",
    "etc/modules-load.d/can.conf": "can\ncan-raw\nvcan\n",
    "etc/systemd/network/10-vcan0.netdev": "[NetDev]\nName=vcan0\nKind=vcan\n",
    # The default brings vcan0 up; the network file that the service installs sorts before it.
    "etc/systemd/network/99-vcan.network": "[Match]\nName=vcan*\n\n[Link]\nRequiredForOnline=no\n",
    "etc/systemd/journald.conf.d/guest.conf": "[Journal]\nStorage=volatile\nRateLimitBurst=0\n",
    "etc/systemd/system/guest.service": """\
[Unit]
Description=the tests
After=multi-user.target systemd-networkd.service
[Service]
Type=idle
ExecStart=/bin/sh /usr/local/bin/waiting.sh
StandardOutput=tty
StandardError=tty
TTYPath=/dev/console
[Install]
WantedBy=multi-user.target
""",
}
ENABLED = ("guest.service", "systemd-networkd.service")
MASKED = ("systemd-timesyncd.service", "getty@tty1.service", "serial-getty@ttyS0.service", "apt-daily.timer",
          "apt-daily-upgrade.timer", "dpkg-db-backup.timer", "e2scrub_all.timer", "e2scrub_reap.service",
          "systemd-networkd-wait-online.service", "fstrim.timer", "systemd-binfmt.service",
          "proc-sys-fs-binfmt_misc.automount", "systemd-tmpfiles-clean.timer", "systemd-pstore.service")  # fmt: skip


def image() -> Path:
    """Folder with the files of `FILES`, built where the recipe has changed.  Raises needs.SkipError."""
    kernel = needs.kernel_package()
    store = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stagectl" / "vm"
    place = store / _key(kernel)
    if all((place / name).exists() for name in FILES):
        return place
    if os.geteuid() != 0:
        raise needs.SkipError("building the guest needs root")
    store.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=store) as folder:
        _build(Path(folder), kernel)
        for old in store.iterdir():  # one is enough: each takes a gigabyte
            if old != Path(folder):
                shutil.rmtree(old)
        ready = place.with_suffix(".new")
        ready.mkdir()
        for name in FILES:
            (Path(folder) / name).rename(ready / name)
        ready.rename(place)
    return place


def _key(kernel: str) -> str:
    digest = hashlib.sha256(kernel.encode())
    for name in RECIPE:
        digest.update((HERE / name).read_bytes())
    return digest.hexdigest()[:16]


def _build(folder: Path, kernel: str) -> None:
    root, version = folder / "root", kernel.removeprefix("linux-image-")
    with ThreadPoolExecutor() as pool:  # these three wait for the network
        for done in [
            pool.submit(_timed, kernel, lambda: _kernel(folder, kernel)),
            pool.submit(_timed, f"Debian {SUITE}", lambda: _debian(root)),
            pool.submit(_timed, "Python packages", lambda: _python(folder / "python")),
        ]:
            done.result()
    (root / _SITE).parent.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(root / _SITE, ignore_errors=True)
    (folder / "python").rename(root / _SITE)
    _timed("modules and initial RAM disk", lambda: _modules(folder, root, folder / "kernel", version))
    _timed("what makes it the guest", lambda: _configured(root))
    _timed("disk", lambda: _disk(folder, root))


def _timed(what: str, step: Callable[[], None]) -> None:
    began = time.monotonic()
    step()
    print(f"  {what}: {time.monotonic() - began:.0f} s", flush=True)


def _run(*command: object, cwd: Path | None = None) -> str:
    """Output of a command.  Raises needs.SkipError with the end of what it said where it fails."""
    words = [str(word) for word in command]
    done = subprocess.run(words, check=False, capture_output=True, text=True, cwd=cwd)
    if done.returncode != 0:
        raise needs.SkipError(f"{' '.join(words[:4])} ...: {(done.stderr or done.stdout).strip()[-800:]}")
    return done.stdout


def _kernel(folder: Path, kernel: str) -> None:
    _run("apt-get", "download", "-q", kernel, cwd=folder)
    (package,) = folder.glob("*.deb")
    _run("dpkg-deb", "-x", package, folder / "kernel")
    shutil.copy(next((folder / "kernel" / "boot").glob("vmlinuz-*")), folder / "vmlinuz")


def _debian(root: Path) -> None:
    _run("mmdebstrap", "--mode=root", "--variant=minbase", f"--include={PACKAGES}", SUITE, root)
    for heavy in ("usr/share/doc", "usr/share/locale", "usr/share/man", "var/cache/apt", "var/lib/apt/lists"):
        shutil.rmtree(root / heavy, ignore_errors=True)


def _python(folder: Path) -> None:
    own = [sys.executable, "-m", "pip"]
    has = subprocess.run([*own, "--version"], check=False, capture_output=True).returncode == 0
    platforms = [word for name in ("manylinux2014_x86_64", "manylinux_2_28_x86_64") for word in ("--platform", name)]
    command = [*(own if has else ["python3", "-m", "pip"]), "install", "-q", "--disable-pip-version-check", "--no-deps"]
    target = ["--target", folder, "--python-version", PYTHON, "--only-binary=:all:", *platforms]
    _run(*command, *target, "-r", HERE / "requirements.txt")
    for tests in (*folder.glob("scipy/**/tests"), *folder.glob("numpy/**/tests")):
        shutil.rmtree(tests)


def _configured(root: Path) -> None:
    for place, text in TEXTS.items():
        path = root / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    shutil.copy(HERE / "waiting.sh", root / "usr" / "local" / "bin")
    _run("chroot", root, "systemctl", "enable", *ENABLED)
    _run("chroot", root, "systemctl", "mask", *MASKED)


def _modules(folder: Path, root: Path, kernel: Path, version: str) -> None:
    """All modules of a name with what they need: into the initial RAM disk, or below the guest's root."""
    tree = kernel / "lib" / "modules" / version
    for packed in tree.rglob("*.ko.xz"):  # later Debians; busybox' insmod reads plain ones
        packed.with_suffix("").write_bytes(lzma.decompress(packed.read_bytes()))
        packed.unlink()
    _run("depmod", "-b", kernel, version)
    ours = root / "usr" / "lib" / "modules" / version
    for path in _needed(kernel, version, LATER):
        copy = ours / path.relative_to(tree)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)
    for path in (*tree.glob("modules.builtin*"), tree / "modules.order"):
        shutil.copy(path, ours)
    _run("depmod", "-b", root, version)
    _initrd(folder, _needed(kernel, version, FIRST))


def _needed(kernel: Path, version: str, names: tuple[str, ...]) -> list[Path]:
    said = [_run("modprobe", "-d", kernel, "-S", version, "--show-depends", name) for name in names]
    lines = [line.split()[1] for text in said for line in text.splitlines() if line.startswith("insmod")]
    return [Path(line) for line in dict.fromkeys(lines)]


def _initrd(folder: Path, modules: list[Path]) -> None:
    small = folder / "initrd"
    for name in ("bin", "modules", "dev", "disk", "layer", "root"):
        (small / name).mkdir(parents=True)
    busybox = shutil.which("busybox")
    assert busybox is not None
    shutil.copy(busybox, small / "bin" / "busybox")
    for applet in ("sh", "mount", "mkdir", "insmod", "cat", "sleep", "switch_root", "["):
        (small / "bin" / applet).symlink_to("busybox")
    for path in modules:
        shutil.copy(path, small / "modules")
    (small / "modules" / "order").write_text(" ".join(path.name for path in modules))
    shutil.copy(HERE / "init", small / "init")
    (small / "init").chmod(0o755)
    names = "\n".join(str(path.relative_to(small)) for path in sorted(small.rglob("*")))
    packed = subprocess.run(
        ["cpio", "-o", "-H", "newc", "--quiet"], input=names.encode(), cwd=small, capture_output=True
    )
    (folder / "initrd.gz").write_bytes(gzip.compress(packed.stdout, 6))


def _disk(folder: Path, root: Path) -> None:
    disk = folder / "root.img"
    _run("truncate", "-s", SIZE, disk)
    _run("mkfs.ext4", "-q", "-F", "-O", "^has_journal", "-d", root, disk)
