"""The page's plots: uPlot, one pinned release, brought by the build or on first use, never committed.

The build (``tools/backend``) puts its files next to the page, into wheel or checkout; where it could not, the
service fetches them once into the user's cache.  Each file is only accepted with its digest below, wherever it
comes from.  Only the standard library: the build runs this without anything installed.
"""

import hashlib
import io
import os
import tarfile
import urllib.request
from pathlib import Path

VERSION = "1.6.32"
_TARBALL = f"uplot/-/uplot-{VERSION}.tgz"
_REGISTRY = "https://registry.npmjs.org"
# Our name: where it is in the tarball, SHA-256.
FILES = {
    "uPlot.min.js": (
        "package/dist/uPlot.iife.min.js",
        "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
    ),
    "uPlot.min.css": ("package/dist/uPlot.min.css", "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04"),
    "uPlot.LICENSE": ("package/LICENSE", "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd"),
}
BUNDLED = Path(__file__).parent / "static" / "plots"
_LARGEST = 4_000_000  # bytes of the tarball
_PATIENCE = 20.0  # s


class AssetError(Exception):
    """uPlot cannot be loaded."""


def cache() -> Path:
    """The user's, or the service's, own place for what can be fetched again."""
    base = os.environ.get("CACHE_DIRECTORY") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "stagectl" / f"uplot-{VERSION}"


def available() -> Path | None:
    """The folder that holds all files intact; None where there is none."""
    return next((folder for folder in (BUNDLED, cache()) if whole(folder)), None)


def whole(folder: Path) -> bool:
    """Whether all files are there, with their digests."""
    try:
        return all(_digest((folder / name).read_bytes()) == digest for name, (_, digest) in FILES.items())
    except OSError:
        return False


def fetch(folder: Path) -> Path:
    """Download the release into `folder`, unless it is there already.

    Raises AssetError with the reason where that fails.
    """
    if whole(folder):
        return folder
    url = f"{os.environ.get('NPM_CONFIG_REGISTRY', _REGISTRY).rstrip('/')}/{_TARBALL}"
    try:
        with urllib.request.urlopen(url, timeout=_PATIENCE) as answer:
            store(answer.read(_LARGEST), folder)
    except (OSError, ValueError, tarfile.TarError) as error:
        raise AssetError(f"uPlot {VERSION} cannot be loaded from {url}: {error}") from error
    return folder


def store(tarball: bytes, folder: Path) -> None:
    """Write the files of the release; each only with its digest.

    Raises AssetError where one is not what it must be.
    """
    with tarfile.open(fileobj=io.BytesIO(tarball)) as archive:
        members = {name: archive.extractfile(place) for name, (place, _) in FILES.items()}
        contents = {name: member.read() for name, member in members.items() if member is not None}
    for name, (place, digest) in FILES.items():
        if _digest(contents.get(name, b"")) != digest:
            raise AssetError(f"{place} of uPlot {VERSION} has a wrong digest: not used")
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        fresh = folder / f"{name}.{os.getpid()}"
        fresh.write_bytes(content)
        os.replace(fresh, folder / name)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
