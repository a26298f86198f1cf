"""The plots are taken only as they must be, wherever they come from."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path

import pytest

from stagectl.web import assets


def tarball(**changes: bytes) -> bytes:
    """A release whose files hold their own names, but for `changes`."""
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w:gz") as archive:
        for name, (place, _) in assets.FILES.items():
            text = changes.get(name.split(".")[1], name.encode())
            member = tarfile.TarInfo(place)
            member.size = len(text)
            archive.addfile(member, io.BytesIO(text))
    return content.getvalue()


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Digests of what `tarball` makes."""
    files = {name: (place, assets._digest(name.encode())) for name, (place, _) in assets.FILES.items()}
    monkeypatch.setattr(assets, "FILES", files)


def test_what_is_right_is_taken(tmp_path: Path) -> None:
    assert not assets.whole(tmp_path)
    assets.store(tarball(), tmp_path)
    assert assets.whole(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(assets.FILES)


def test_what_was_changed_is_not(tmp_path: Path) -> None:
    with pytest.raises(assets.AssetError, match="wrong digest"):
        assets.store(tarball(min=b"alert(1)"), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_was_changed_afterwards_is_not_served(tmp_path: Path) -> None:
    assets.store(tarball(), tmp_path)
    (tmp_path / "uPlot.min.js").write_text("alert(1)")
    assert not assets.whole(tmp_path)


def test_without_a_network_it_says_where_it_looked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", "http://127.0.0.1:9/")
    with pytest.raises(assets.AssetError, match=r"cannot be loaded from http://127.0.0.1:9/uplot/-/uplot-1"):
        assets.fetch(tmp_path)


def test_a_mirror_that_gives_something_else_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "uplot" / "-").mkdir(parents=True)
    (tmp_path / "uplot" / "-" / f"uplot-{assets.VERSION}.tgz").write_bytes(tarball(LICENSE=b"other"))
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", tmp_path.as_uri())
    with pytest.raises(assets.AssetError, match="wrong digest"):
        assets.fetch(tmp_path / "here")
    (tmp_path / "uplot" / "-" / f"uplot-{assets.VERSION}.tgz").write_bytes(b"no archive")
    with pytest.raises(assets.AssetError, match="cannot be loaded"):
        assets.fetch(tmp_path / "here")
