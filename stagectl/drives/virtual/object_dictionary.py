"""Object dictionary of the virtual drive: its live values, the effect of a write, and the error history."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from stagectl.drives.canopen import cia402
from stagectl.drives.canopen.library import SdoAbortedError, canopen
from stagectl.drives.canopen.pdo import CODES
from stagectl.drives.drive import Canopen, DriveError
from stagectl.drives.virtual import pdo_mapping
from stagectl.drives.virtual.homing import DIRECTIONS, HomingOptions
from stagectl.drives.virtual.power_stage import PowerStage, StopOptions

TARGET_CURRENT, ACTUAL_CURRENT = 0x2071, 0x2077  # vendor objects, finer than per mille of the rated current
FINE = 1e-5  # A a count of them
_HISTORY = 8  # entries of 0x1003
_MODES = (0, cia402.HOMING, cia402.CYCLIC_SYNCHRONOUS_TORQUE)
_ADMITTED = {  # what an interval in the EDS cannot say
    cia402.QUICK_STOP_OPTION: (0, 1, 2, 5, 6),
    cia402.MODE: _MODES,
    cia402.HOMING_METHOD: (0, *DIRECTIONS),
    cia402.ERROR_HISTORY: (0,),  # clears it
}


class Objects:
    """The dictionary of a `canopen.LocalNode`, tied to the axis.  Keys are index << 8 | subindex."""

    def __init__(self, settings: Canopen, node: canopen.LocalNode, axis: PowerStage) -> None:
        """Raises DriveError where the scales in `settings` are not those of this drive."""
        self.node, self.axis = node, axis
        self.changed = True  # something that is kept compiled or in SI units was written
        self.error_code = self.error_register = 0
        self._history: list[int] = []
        self._permille = settings.rated_current * cia402.TORQUE_PERMILLE
        self._check_scales(settings)
        self.getters = self._live()
        self.setters = self._obeyed()
        node.sdo._index = node.sdo._subindex = 0  # the library's server fails on an abort before any request
        node.sdo._buffer = bytearray()
        node.add_read_callback(self._read)  # type: ignore[no-untyped-call]
        node.add_write_callback(self._written)  # type: ignore[no-untyped-call]
        self.restore(settings)

    def number(self, index: int, subindex: int = 0) -> int:
        """Present value of an integer object."""
        getter = self.getters.get(index << 8 | subindex)
        if getter is not None:
            return int(getter())
        variable: Any = self.node.object_dictionary.get_variable(index, subindex)
        return int(variable.decode_raw(self.node.get_data(index, subindex)))

    def reader(self, key: int) -> Callable[[], int]:
        """What gives the present value of an object, for the cyclic path."""
        return self.getters.get(key) or (lambda: self.number(key >> 8, key & 0xFF))

    def restore(self, settings: Canopen, communication_only: bool = False) -> None:
        """Defaults of the EDS again, as a reset does."""
        store = self.node.data_store
        for index in [i for i in store if not communication_only or i < 0x2000]:
            del store[index]
        rated = round(settings.rated_current * 1e3)  # mA
        store[cia402.RATED_CURRENT] = {0: rated.to_bytes(4, "little")}
        self._history.clear()
        self.error_code = self.error_register = 0
        if not communication_only:
            self.axis.brake.restart()
        self.changed = True

    def options(self) -> StopOptions:
        """Option codes and the ramp of the drive's own stop, in SI units."""
        step = self.axis.plant.p.encoder.step
        permille = min(self.number(0x6072), self.number(0x6073))  # max torque, max current
        return StopOptions(
            quick_stop=self.number(cia402.QUICK_STOP_OPTION),
            fault_reaction=self.number(cia402.FAULT_REACTION),
            abort_connection=self.number(cia402.ABORT_CONNECTION),
            deceleration=self.number(cia402.QUICK_STOP_DECELERATION) * step,
            current_limit=math.inf if permille == 0xFFFF else permille * self._permille,
        )

    def homing(self) -> HomingOptions:
        """Method, speed and ramp of the drive's own homing, in SI units."""
        step, number = self.axis.sensor.step, self.number
        return HomingOptions(
            method=number(cia402.HOMING_METHOD),
            speed=number(cia402.HOMING_SPEEDS, 1) * step,
            acceleration=number(cia402.HOMING_ACCELERATION) * step,
            offset=number(cia402.HOME_OFFSET),
        )

    def error(self, code: int, register: int) -> None:
        """Note an error in 0x603F, 0x1001 and 0x1003, and send it as an emergency."""
        self.error_code, self.error_register = code, self.error_register | register
        self._history = [code, *self._history][:_HISTORY]
        self.node.emcy.send(code, self.error_register)

    def error_over(self) -> None:
        """No error is left: say so on the bus."""
        if self.error_code:
            self.error_code = self.error_register = 0
            self.node.emcy.reset()

    def _live(self) -> dict[int, Callable[[], int]]:
        axis = self.axis
        plant, step = axis.plant, axis.plant.p.encoder.step
        live = {
            cia402.CONTROLWORD << 8: lambda: axis.controlword,
            cia402.STATUSWORD << 8: lambda: axis.statusword,
            cia402.MODE << 8: lambda: axis.mode,
            cia402.MODE_DISPLAY << 8: lambda: axis.mode,
            cia402.POSITION << 8: lambda: (axis.sensor.counts + 2**31) % 2**32 - 2**31,
            cia402.VELOCITY << 8: lambda: _count(axis.sensor.velocity, step, 31),
            cia402.TARGET_TORQUE << 8: lambda: _count(axis.target, self._permille, 15),
            cia402.ACTUAL_TORQUE << 8: lambda: _count(plant.current, self._permille, 15),
            TARGET_CURRENT << 8: lambda: _count(axis.target, FINE, 31),
            ACTUAL_CURRENT << 8: lambda: _count(plant.current, FINE, 31),
            cia402.ERROR_CODE << 8: lambda: self.error_code,
            cia402.ERROR_REGISTER << 8: lambda: self.error_register,
            cia402.ERROR_HISTORY << 8: lambda: len(self._history),
        }
        for n in range(1, _HISTORY + 1):
            live[cia402.ERROR_HISTORY << 8 | n] = lambda n=n: self._past_error(n)  # type: ignore[misc]
        return live

    def _obeyed(self) -> dict[int, Callable[[int], None]]:
        return {
            cia402.CONTROLWORD << 8: self._control,
            cia402.MODE << 8: self._set_mode,
            cia402.TARGET_TORQUE << 8: lambda count: self._aim(count * self._permille),
            TARGET_CURRENT << 8: lambda count: self._aim(count * FINE),
            cia402.ERROR_HISTORY << 8: lambda _: self._history.clear(),
            cia402.DIGITAL_OUTPUTS << 8 | 1: partial(setattr, self.axis.brake, "outputs"),
            cia402.DIGITAL_OUTPUTS << 8 | 2: partial(setattr, self.axis.brake, "mask"),
        }

    def _control(self, controlword: int) -> None:
        before = self.axis.state
        self.axis.control(controlword)
        if before is cia402.DriveState.FAULT and self.axis.state is not before:
            self.error_over()

    def _set_mode(self, mode: int) -> None:
        if mode in _MODES:  # an RPDO with another mode is ignored; `_check` aborts such an SDO
            self.axis.mode = mode

    def _aim(self, current: float) -> None:
        if self.axis.state is cia402.DriveState.OPERATION_ENABLED:
            self.axis.target = current

    def _past_error(self, n: int) -> int:
        if n > len(self._history):
            raise SdoAbortedError(0x0800_0024)  # no data available
        return int(self._history[n - 1])

    def _read(self, *, index: int, subindex: int, od: Any) -> int | None:
        getter = self.getters.get(index << 8 | subindex)
        return None if getter is None else getter()

    def _written(self, *, index: int, subindex: int, od: Any, data: bytes) -> None:
        if od.data_type not in CODES:
            return
        value = int(od.decode_raw(bytes(data)))
        self._check(index, subindex, od, value)
        self.changed = True
        setter = self.setters.get(index << 8 | subindex)
        if setter is not None:
            setter(value)

    def _check(self, index: int, subindex: int, od: Any, value: int) -> None:
        """Raises SdoAbortedError where the object does not take `value`."""
        low, high = od.min, od.max
        if (low is not None and value < low) or (high is not None and value > high):
            raise SdoAbortedError(cia402.OUT_OF_RANGE)
        allowed = _ADMITTED.get(index)
        if allowed is not None and value not in allowed:
            raise SdoAbortedError(cia402.OUT_OF_RANGE)
        pdo_mapping.check(self.node.object_dictionary, self.number, index, subindex, value)

    def _check_scales(self, settings: Canopen) -> None:
        fine = {TARGET_CURRENT << 8: FINE, ACTUAL_CURRENT << 8: FINE}
        coarse = {cia402.TARGET_TORQUE << 8: self._permille, cia402.ACTUAL_TORQUE << 8: self._permille}
        for key, scale, name in (
            (settings.command_object, settings.command_scale, "command_scale"),
            (settings.current_object, settings.current_scale, "current_scale"),
        ):
            mine = (fine | coarse).get(key)
            if mine is not None and not math.isclose(mine, scale, rel_tol=1e-9):
                raise DriveError(
                    f"{name} = {scale} A; must be {mine} A for object 0x{key:06X} of the virtual drive",
                    place=name,
                    object_key=key,
                    value=scale,
                )


def _count(value: float, scale: float, bits: int) -> int:
    """`value` in counts of `scale`, rounded, within a signed integer of `bits` + 1."""
    return min(max(math.floor(value / scale + 0.5), -(1 << bits)), (1 << bits) - 1)
