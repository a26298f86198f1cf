"""What building and running the guest takes from the host, and the installation of what is missing."""

import os
import platform
import shutil
import subprocess

PACKAGES = {  # program: Debian package
    "qemu-system-x86_64": "qemu-system-x86",
    "mmdebstrap": "mmdebstrap",
    "busybox": "busybox-static",
    "mkfs.ext4": "e2fsprogs",
    "cpio": "cpio",
    "depmod": "kmod",
}
_SBIN = "/usr/local/sbin:/usr/sbin:/sbin"


class SkipError(Exception):
    """The guest cannot be had on this machine; the message says why."""


def present() -> None:
    """Install what is missing.  Raises SkipError with the reason where that is not possible."""
    os.environ["PATH"] += f":{_SBIN}"
    if platform.machine() != "x86_64" or not platform.system() == "Linux":
        raise SkipError(f"the guest is built for x86_64 Linux, this is {platform.machine()} {platform.system()}")
    missing = [package for program, package in PACKAGES.items() if shutil.which(program) is None]
    if not missing:
        return
    if shutil.which("apt-get") is None:
        raise SkipError(f"no apt-get here to install {' '.join(missing)} with")
    if os.geteuid() != 0:
        raise SkipError(f"not root: sudo apt-get install --no-install-recommends {' '.join(missing)}")
    print(f"installing {' '.join(missing)}", flush=True)
    quiet = {"env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}, "capture_output": True, "text": True}
    subprocess.run(["apt-get", "update", "-q"], check=False, **quiet)
    done = subprocess.run(["apt-get", "install", "-qy", "--no-install-recommends", *missing], check=False, **quiet)
    if done.returncode != 0:
        raise SkipError(f"apt-get install {' '.join(missing)}: {done.stderr.strip()[-300:]}")


def kernel_package() -> str:
    """Name of Debian's current PREEMPT_RT kernel.  Raises SkipError where apt knows none."""
    package = _kernel()
    if not package and os.geteuid() == 0:  # a container's lists may be empty
        subprocess.run(["apt-get", "update", "-q"], check=False, capture_output=True)
        package = _kernel()
    if not package:
        raise SkipError("apt offers no linux-image-rt-amd64: the guest's kernel comes from Debian's main archive")
    return package


def _kernel() -> str:
    said = subprocess.run(["apt-cache", "depends", "linux-image-rt-amd64"], check=False, capture_output=True, text=True)
    return next((line.split()[-1] for line in said.stdout.splitlines() if "Depends: linux-image" in line), "")
