"""The build backend (PEP 517): setuptools, with the live page's plots (web/assets.py) and the systemd units."""

import importlib.util
import shutil
import sys
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  everything else is its own

_ROOT = Path(__file__).parents[2]
_UNITS = _ROOT / "stagectl" / "service" / "units"
_PLACE = _ROOT / "stagectl" / "web" / "assets.py"


def build_wheel(*given: Any, **named: Any) -> str:
    """A wheel with the plots, and with the units of `systemd/`."""
    _fetch()
    shutil.copytree(_ROOT / "systemd", _UNITS, dirs_exist_ok=True)
    try:
        return str(build_meta.build_wheel(*given, **named))
    finally:
        shutil.rmtree(_UNITS)  # a checkout reads them from systemd/


def build_editable(*given: Any, **named: Any) -> str:
    """An editable install, the plots beside the page in the checkout."""
    _fetch()
    return str(build_meta.build_editable(*given, **named))


def _fetch() -> None:
    """Bring the plots; without a network the page fetches them on first use."""
    assets = _assets()
    try:
        assets.fetch(assets.BUNDLED)
    except assets.AssetError as error:
        print(f"warning: {error}; the live page will fetch it on first use", file=sys.stderr)


def _assets() -> Any:
    """The module by its place: the package itself cannot be imported before it is built."""
    spec = importlib.util.spec_from_file_location("stagectl_assets", _PLACE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
