"""The embedded bus as an interface of python-can, under the name ``stagectl``.

So that the tools its users know see what the stage says::

    python -m can.logger -i stagectl -c stage
    python -m can.viewer -i stagectl -c stage
    canopen.Network().connect(interface="stagectl", channel="stage")
"""

import time
from typing import Any

import can

from stagectl.drives.bus.embedded import Embedded
from stagectl.drives.bus.frames import EXTENDED, REMOTE, BusError, frame, parse
from stagectl.drives.limits import PLUGIN_WAIT


class EmbeddedBus(can.BusABC):
    """A participant of the embedded bus for python-can."""

    def __init__(self, channel: Any = "stage", can_filters: Any = None, **options: Any) -> None:
        """Join `channel`, a name or a folder.  Options such as a bit rate mean nothing here and are ignored.

        Raises can.CanInitializationError where the channel cannot be joined.
        """
        try:
            self._bus = Embedded(str(channel))
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        self.channel_info = f"stagectl embedded bus {self._bus.folder}"
        super().__init__(channel=channel, can_filters=can_filters, **options)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one classic CAN frame; never blocks."""
        if msg.is_fd:
            raise can.CanOperationError("the embedded bus carries classic CAN frames, not CAN FD")
        flags = EXTENDED * msg.is_extended_id | REMOTE * msg.is_remote_frame
        try:
            self._bus.send(frame(msg.arbitration_id | flags, bytes(msg.data)))
        except OSError as error:
            raise can.CanOperationError(str(error)) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            raw = self._bus.receive(PLUGIN_WAIT if timeout is None else timeout)
        except (OSError, ValueError) as error:  # ValueError: select on a socket that was closed meanwhile
            raise can.CanOperationError(str(error)) from error
        if raw is None:
            return None, False
        identifier, data = parse(raw)
        message = can.Message(
            timestamp=time.time(),
            arbitration_id=identifier & 0x1FFF_FFFF,
            is_extended_id=bool(identifier & EXTENDED),
            is_remote_frame=bool(identifier & REMOTE),
            data=data,
            channel=self.channel_info,
        )
        return message, False

    def fileno(self) -> int:
        """Descriptor for select, as `can.Notifier` uses it."""
        return self._bus.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._bus.close()
