"""The axes of a machine, from the arguments of `serve`: one file, one with `axes`, or several on one bus."""

from pathlib import Path

from stagectl.config.machine_file import axes_of, coupled, split
from stagectl.config.stage_file import load_stage
from stagectl.drives.cycle_time import bus_load
from stagectl.drives.drive import Canopen
from stagectl.service.axis_controller import AxisController, ServiceError


def named(stages: list[str]) -> dict[str, Path]:
    """The stage file of each axis by its name, from a file, a file with `axes`, or ``x=STAGE.yaml y=STAGE.yaml``.

    Raises ConfigError, and ServiceError for names that cannot be.
    """
    files: dict[str, Path] = {}
    for text in stages:
        name, equals, path = text.rpartition("=")
        references = [Path(path)] if equals else axes_of(Path(path))
        for reference in references:
            own = name.strip() if equals else split(reference)[1] or "axis"
            if not own.isidentifier() or own in files:
                raise ServiceError(f"{text}: each stage needs a name of its own that is an identifier: x={path} y=...")
            files[own] = reference
    return files


def together(stages: list[str]) -> bool:
    """Whether a fault of one axis stops all: what a file with `axes` says, otherwise yes."""
    return all(coupled(path) for path in named(stages).values())


def machine(stages: list[str], channel: str | None) -> dict[str, AxisController]:
    """The axes by name; see `named`.

    Raises ConfigError for what is wrong with a file, ServiceError where the axes cannot share a bus.
    """
    axes = {}
    for name, path in named(stages).items():
        setup = load_stage(path)
        if channel is not None and isinstance(setup.file.drive.wire, Canopen):
            setup = setup.with_wire(channel=channel)
        axes[name] = AxisController(name, setup)
    _check(axes)
    return axes


def virtual(axes: dict[str, AxisController]) -> bool:
    """Whether nothing real can be moved: all plants are in this machine's memory."""
    return all(axis.setup.file.in_memory for axis in axes.values())


def _check(axes: dict[str, AxisController]) -> None:
    """What axes in one process and on one bus must have in common, and what they must not."""
    if len(axes) == 1:
        return
    period, *others = (axis.setup.dt for axis in axes.values())
    if any(other != period for other in others):
        raise ServiceError(f"control.period is {sorted({period, *others})} s: axes of one SYNC need the same")
    wires = [axis.setup.file.drive.wire for axis in axes.values()]
    canopen = [wire for wire in wires if isinstance(wire, Canopen)]
    places: dict[tuple[str, str, int], str] = {}
    for name, axis in axes.items():
        wire = axis.setup.file.drive.wire
        place = (wire.interface, wire.channel, wire.node) if isinstance(wire, Canopen) else None
        if place in places:
            both = f"axes {places[place]} and {name}: drive.wire.node = {place[2]} on {place[0]} {place[1]}"
            raise ServiceError(f"{both} for both: give each another number (axis {name}: {axis.setup.path})")
        if place is not None:
            places[place] = name
    for where in {(wire.interface, wire.channel) for wire in canopen}:
        _check_load([wire for wire in canopen if (wire.interface, wire.channel) == where], period)


def _check_load(wires: list[Canopen], period: float) -> None:
    lengths = (0, *(8 for _ in wires for _ in range(2)))
    share, limit = bus_load(1.0 / period, wires[0].bitrate, lengths), min(wire.bus_load_limit for wire in wires)
    if share > limit:
        raise ServiceError(
            f"{len(wires)} axes on {wires[0].channel}: SYNC and two PDOs each every {period * 1e3:g} ms take "
            f"{100 * share:.0f} % of the bus, the limit is {100 * limit:.0f} %: take control.period of at least "
            f"{period * share / limit * 1e3:.3g} ms"
        )
