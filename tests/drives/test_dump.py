"""A drive's objects, as it has them and not as its EDS says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import canopen
import pytest

from stagectl.drives.canopen.dump import dump, write_dcf
from stagectl.drives.drive import DriveError
from stagectl.units import StageError
from tests.drives.workbench import EDS, Workbench


def test_it_reads_what_the_drive_has(bench: Workbench, tmp_path: Path) -> None:
    node = bench.running()
    asked: list[tuple[int, int]] = []
    result = dump(bench.settings(), bench.bus(), lambda done, total: asked.append((done, total)))
    by_place = {(entry.number, entry.subindex): entry for entry in result}
    assert len(by_place) == len(result) == asked[-1][0] == asked[-1][1] > 50
    assert by_place[0x1000, 0].value == 0x20192  # CiA 402, a servo drive
    assert by_place[0x6040, 0].name == "Controlword"
    assert isinstance(by_place[0x6041, 0].value, int)
    assert all(entry.access != "wo" for entry in result)
    write_dcf(result, str(EDS), 5, tmp_path / "drive.dcf")
    again = canopen.import_od(str(tmp_path / "drive.dcf"), 5)
    assert again.node_id == 5
    values = {
        (entry.number, entry.subindex): entry.value
        for entry in result
        if not entry.problem and isinstance(entry.value, int)
    }
    assert len(values) > 50
    for (index, subindex), value in values.items():
        entry: Any = again[index]
        if not isinstance(entry, canopen.objectdictionary.ODVariable):
            entry = entry[subindex]
        assert entry.value == value, hex(index)
    assert node is not None


def test_nobody_there(bench: Workbench) -> None:
    with pytest.raises(DriveError, match="stagectl doctor"):
        dump(bench.settings(), bench.bus())


def test_it_replaces_only_a_dcf_of_its_own(tmp_path: Path) -> None:
    own, other, stage = tmp_path / "own.dcf", tmp_path / "other.dcf", tmp_path / "stage.yaml"
    write_dcf([], str(EDS), 5, own)
    write_dcf([], str(EDS), 5, own)
    other.write_text("[FileInfo]\n")
    stage.write_text("name: mine\n")
    for taken in (other, stage):
        before = taken.read_text()
        with pytest.raises(StageError):
            write_dcf([], str(EDS), 5, taken)
        assert taken.read_text() == before
