"""What a drive under power must go on showing: the bits that it has shown, and its mode."""

from __future__ import annotations

import pytest

from stagectl.drives.canopen import fault_texts
from stagectl.drives.canopen.fault_texts import Deviation
from stagectl.drives.canopen.operation_watch import MODE_REQUEST, OperationWatch, mode_place
from stagectl.drives.canopen.pdo import PdoMap
from stagectl.drives.limits import LEARNING_TIME, STATUS_BIT_TIME

DT = 5e-4
GOOD, LEARNED = 0x1637, round(LEARNING_TIME / DT)
PATIENCE = round(STATUS_BIT_TIME / DT)


def fed(watch: OperationWatch, statusword: int, periods: int) -> tuple[Deviation | None, int]:
    """What the cyclic path finds, and in which period."""
    for k in range(periods):
        if statusword & watch.mask != watch.expected and (deviation := watch.look(statusword)) is not None:
            return deviation, k + 1
    return None, periods


@pytest.mark.parametrize("bit", [9, 12])
def test_a_bit_that_was_shown_must_stay(bit: int) -> None:
    watch = OperationWatch(DT, None)
    assert fed(watch, GOOD, LEARNED + 10) == (None, LEARNED + 10)
    lost = GOOD & ~(1 << bit)
    assert fed(watch, lost, PATIENCE - 1)[0] is None  # not yet certain
    assert fed(watch, GOOD, 1)[0] is None
    assert fed(watch, lost, 100) == (fault_texts.LOST_BITS[bit], PATIENCE)


def test_a_bit_that_was_never_shown_is_not_demanded_unless_it_is_named() -> None:
    silent = 0x0637  # no bit 12
    watch = OperationWatch(DT, None)
    fed(watch, silent, LEARNED)
    assert fed(watch, silent, 1000)[0] is None
    assert watch.unshown == (12,)
    named = OperationWatch(DT, (12,))
    fed(named, silent, LEARNED)
    assert fed(named, silent, 1000)[0] is fault_texts.LOST_BITS[12]
    unwatched = OperationWatch(DT, ())
    fed(unwatched, GOOD, LEARNED)
    assert fed(unwatched, 0x0437, 1000)[0] is None


@pytest.mark.parametrize(("bits", "silent"), [(None, 0x0637), ((12,), 0x0637), ((9,), 0x1437)])
def test_it_is_ready_as_soon_as_it_shows_all_or_after_a_while(bits: tuple[int, ...] | None, silent: int) -> None:
    """Some take commands, and say so by bit 12, only some time after they are enabled."""
    watch = OperationWatch(DT, bits)
    fed(watch, silent, LEARNED // 2)
    assert not watch.learned
    fed(watch, GOOD, 1)
    assert watch.learned
    never = OperationWatch(DT, bits)
    fed(never, silent, LEARNED - 1)
    assert not never.learned
    fed(never, silent, 1)
    assert never.learned


def test_a_good_period_costs_one_comparison() -> None:
    watch = OperationWatch(DT, None)
    fed(watch, GOOD, LEARNED)
    assert GOOD & watch.mask == watch.expected


def answer(mode: int) -> bytes:
    return bytes([0x4F, 0x61, 0x60, 0x00]) + mode.to_bytes(4, "little", signed=True)


def test_another_mode_is_told_when_it_is_certain() -> None:
    watch = OperationWatch(DT, None)
    assert [watch.mode(answer(mode)) for mode in (0, 0, 0)] == [None] * 3  # a drive that never shows it
    assert not watch.mode_shown  # and gets no motion
    assert watch.mode(answer(10)) is None and watch.mode_shown
    assert watch.mode(answer(8)) is None
    assert watch.mode(bytes([0x80, 0x61, 0x60, 0, 0, 0, 2, 6])) is None  # aborted
    assert watch.mode(bytes([0x43, 0x41, 0x60, 0, 8, 0, 0, 0])) is None  # of another object
    assert watch.mode(answer(8)) == fault_texts.WRONG_MODE.filled(8, 10)
    assert bytes([0x40, 0x61, 0x60, 0, 0, 0, 0, 0]) == MODE_REQUEST


def test_where_the_mode_is_in_a_frame() -> None:
    assert mode_place(PdoMap(0x185, (0x6041_0010, 0x6061_0008, 0x6064_0020))) == 10
    assert mode_place(PdoMap(0x185, (0x6041_0010, 0x6064_0020))) == 0
