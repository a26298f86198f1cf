"""Sockets in the file system: what is replaced, and what is left alone."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from stagectl.runtime_folder import short_name
from stagectl.service.axis_controller import ServiceError
from stagectl.service.single_instance import serving

KINDS = [socket.SOCK_STREAM, socket.SOCK_DGRAM]


@pytest.mark.parametrize("kind", KINDS)
def test_an_ordinary_file_is_left_alone(tmp_path: Path, kind: socket.SocketKind) -> None:
    path = tmp_path / "precious"
    path.write_text("data")
    link = tmp_path / "link"
    link.symlink_to(path)
    for place in (path, link):
        with pytest.raises(ServiceError), serving(place, kind):
            pass
    assert path.read_text() == "data" and link.is_symlink()


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_killed_service_left_is_replaced_and_what_serves_is_not(tmp_path: Path, kind: socket.SocketKind) -> None:
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX, kind) as dead, short_name(path) as name:
        dead.bind(name)
    with serving(path, kind):
        with pytest.raises(ServiceError), serving(path, kind):
            pass
        assert path.is_socket()
    assert not path.exists()


def test_another_ones_name_is_not_removed(tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with serving(path, socket.SOCK_STREAM):
        path.unlink()
        path.write_text("another's")
    assert path.read_text() == "another's"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make another user's socket")
def test_another_users_socket_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other, short_name(path) as name:
        other.bind(name)
    os.chown(path, 12345, 12345)
    with pytest.raises(ServiceError), serving(path, socket.SOCK_STREAM):
        pass
    assert path.is_socket()
