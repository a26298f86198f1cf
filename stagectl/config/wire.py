"""The wire of a stage to its drive, and the same stage on another one."""

from stagectl.config.stage_file import Setup
from stagectl.drives.drive import Canopen, DriveError


def canopen(setup: Setup) -> Canopen:
    """The CANopen wire of the stage.  Raises DriveError where the stage has none."""
    wire = setup.file.drive.wire
    if not isinstance(wire, Canopen):
        words = "this is for a drive on a CAN bus; `stagectl run` and `serve` take other drives, too"
        raise DriveError(f"drive.wire.kind of {setup.path} is not canopen: {words}")
    if setup.stage.drive.delay_samples < 1:
        raise DriveError(
            f"drive.delay_samples = 0; over CAN the command acts from the next SYNC on, so it is at least 1: "
            f"`simulate` can do without the delay, a bus cannot ({setup.path})"
        )
    return wire


def on_channel(setup: Setup, channel: str | None) -> Setup:
    """The same stage on another channel of its bus."""
    if channel is None:
        return setup
    canopen(setup)
    return setup.with_wire(channel=channel)


def lasting(setup: Setup) -> Setup:
    """The same stage, whose virtual machine is not made anew for each run: it stays where it is, its noise goes on."""
    wire = setup.file.drive.wire
    if not isinstance(wire, Canopen) or wire.interface != "embedded":
        return setup
    return setup.with_wire(reset="none")


def with_machine_of_the_day(setup: Setup, seed: int) -> Setup:
    """The same stage, whose virtual drive is a machine drawn with this `seed`."""
    return setup.having(virtual_drive=setup.file.virtual_drive._replace(machine_of_the_day=seed))
