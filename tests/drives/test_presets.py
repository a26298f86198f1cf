"""Families of drives: scales by the makers' own worked figures, and what a probe reads and writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from stagectl.drives.bus.frames import EXTENDED, frame
from stagectl.drives.canopen import presets
from stagectl.drives.canopen.configuration import DriveConfiguration
from stagectl.drives.canopen.object_rules import Wishes
from stagectl.drives.canopen.probe import probe
from stagectl.drives.drive import DriveError
from tests.drives.workbench import EDS, STEP, Script, Workbench


def test_four_families_and_each_says_where_it_is_written() -> None:
    families = [entry for entry in presets.PRESETS if entry.vendor and entry.standing != "tried"]
    assert len(families) >= 4
    assert len({entry.vendor for entry in families}) == len(families)
    assert all(entry.documents and entry.notes for entry in presets.PRESETS)
    assert all(entry.standing == "from documentation, not tried on hardware" for entry in families)


def test_the_makers_own_worked_figure() -> None:
    """Elmo's guide, page 104: 2 A of a motor rated 3200 mA are 625 in 0x6071."""
    values = presets.wire_values(presets.BY_NAME["elmo-gold"], 3.2)
    assert 2.0 / values["command_scale"] == pytest.approx(625.0)
    assert values["command_object"] == 0x6071_00


def test_vendors_choose_their_family() -> None:
    assert presets.for_vendor(0xFB).name == "maxon-epos4"
    assert presets.for_vendor(0x9A).name == "elmo-gold"
    assert presets.for_vendor(0xFFFF).name == "cia402"
    assert presets.for_vendor(None).name == "cia402"


def _eds(folder: Path, vendor: int) -> str:
    """The virtual drive's EDS with another vendor."""
    text = EDS.read_text()
    head, tail = text.split("[1018sub1]")
    assert "DefaultValue=0x00000000" in tail
    path = folder / "other.eds"
    head = head.replace("VendorNumber=0x00000000", f"VendorNumber=0x{vendor:08X}")
    path.write_text(f"{head}[1018sub1]{tail.replace('DefaultValue=0x00000000', f'DefaultValue=0x{vendor:08X}', 1)}")
    return str(path)


def test_a_probe_reads_the_drive_and_proposes_its_family(bench: Workbench, tmp_path: Path) -> None:
    eds = _eds(tmp_path, 0x9A)
    node = bench.running(eds=eds, rated_current=3.2, current_scale=0.0032)
    before = dict(node.objects.node.data_store)
    result = probe(bench.settings(eds=eds), bench.bus())
    assert result.vendor == 0x9A
    assert result.preset.name == "elmo-gold"
    assert result.rated == pytest.approx(3.2)
    assert result.values["command_scale"] == pytest.approx(3.2e-3)
    assert result.answers["quick stop option (0x605A)"].startswith("2: slow down on the quick stop ramp")
    assert result.answers["state"].startswith("Switch on disabled")
    assert "deceleration_scale" not in result.values  # its ramps count encoder steps, as without that entry
    assert result.doubts == ()
    (doubt,) = probe(bench.settings(eds=eds, deceleration_scale=0.1), bench.bus()).doubts
    assert "remove drive.wire.deceleration_scale" in doubt
    assert dict(node.objects.node.data_store) == before  # nothing was written


def test_what_the_drive_does_not_tell_is_a_doubt(bench: Workbench, tmp_path: Path) -> None:
    eds = _eds(tmp_path, 0xFB)
    bench.running(eds=eds)  # no 0x3001:01 in this dictionary, and no 0x60AA
    result = probe(bench.settings(eds=eds), bench.bus())
    assert (result.preset.name, result.rated, result.values) == ("maxon-epos4", None, {})
    assert "--rated" in result.doubts[0]
    given = probe(bench.settings(eds=eds), bench.bus(), rated=5.0)
    assert given.values["command_scale"] == pytest.approx(5e-3)
    assert given.values["deceleration_scale"] == pytest.approx(0.104719755)  # a revolution a minute per second
    assert given.doubts == ()


def test_a_chosen_family_wins_over_the_vendor(bench: Workbench) -> None:
    bench.running()
    result = probe(bench.settings(), bench.bus(), presets.BY_NAME["cia402"])
    assert result.preset.name == "cia402"
    assert "0x6085" in result.doubts[0]


def test_an_eds_of_another_drive_is_a_doubt(bench: Workbench, tmp_path: Path) -> None:
    """The stage file names the EDS of vendor 0x9A; the drive says that it is another, and that file lacks 0x6077."""
    bench.running()
    path = Path(_eds(tmp_path, 0x9A))
    path.write_text(path.read_text().replace("[6077]", "[6F77]"))
    result = probe(bench.settings(eds=str(path)), bench.bus())
    assert any(
        "is for vendor 0x0000009A, the drive reports 0x00000000: take its own EDS" in entry for entry in result.doubts
    )
    assert any("has no 0x6077" in entry for entry in result.doubts)


def test_nobody_there_is_said_with_the_next_step(bench: Workbench) -> None:
    bench.bus()
    with pytest.raises(DriveError, match="stagectl doctor") as caught:
        probe(bench.settings(), bench.bus())
    assert caught.value.node == 5


def test_a_wrong_id_names_who_does_answer(bench: Workbench) -> None:
    bench.running()
    with pytest.raises(DriveError, match="'node: 5'") as caught:
        probe(bench.settings(node=9), bench.bus())
    assert caught.value.node == 9


def test_another_kind_of_device_is_no_drive() -> None:
    """A CiA 401 module answers under the node id."""
    bus = Script()
    bus.steps = [frame(0x585, bytes.fromhex("43 00 10 00 91 01 0F 00"))]
    from tests.drives.workbench import canopen_settings

    with pytest.raises(DriveError, match="402") as caught:
        probe(canopen_settings("unused"), bus)
    assert (caught.value.object_key, caught.value.value) == (0x100000, 0x000F_0191)
    assert all(not int.from_bytes(raw[:4], "little") & EXTENDED for raw in bus.sent)


@pytest.mark.parametrize(("scale", "counts"), [(0.0, 200_000_000), (0.001, 2000)])
def test_the_stop_ramp_in_the_drives_own_unit(bench: Workbench, scale: float, counts: int) -> None:
    """2 m/s^2: in encoder counts of 10 nm, or in the unit that the stage file gives."""
    node = bench.running()
    settings = bench.settings(deceleration_scale=scale)
    DriveConfiguration(Wishes(settings, STEP), bench.bus()).run()
    assert node.objects.number(0x6085) == counts
