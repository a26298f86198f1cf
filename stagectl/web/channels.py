"""The channels of a scope: the columns of its ring, in travel, A and s."""

from collections.abc import Mapping
from typing import NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.problem import nearest
from stagectl.recording.hdf5 import quantities
from stagectl.service.axis_controller import COLUMNS, ServiceError
from stagectl.units import Quantity, UnitError, parse
from stagectl.web.limits import CHANNELS

_HIDDEN = ("time", "true_position")  # the first is the axis of time, the second is not known on a machine
_STATE = Quantity("", "[0, 10]", "state of the axis, see realtime.states.State")


class Channel(NamedTuple):
    """One column."""

    name: str
    column: int
    unit: str  # m | rad of travel, A, s, or none
    scale: float  # from the ring's number to the unit
    meaning: str


def channels(setup: Setup) -> dict[str, Channel]:
    """All channels of an axis by name."""
    axis = setup.file.axis
    known = {}
    for name, quantity in {**quantities(), "state": _STATE}.items():
        if name in _HIDDEN:
            continue
        unit, scale = quantity.unit_for(axis.kind), 1.0
        for angle in ("rad", "m"):
            if unit in (angle, f"{angle}/s"):
                unit, scale = unit.replace(angle, axis.travel_unit, 1), axis.travel_per_unit
        known[name] = Channel(name, COLUMNS.index(name), unit, scale, quantity.meaning)
    return known


def described(known: Mapping[str, Channel]) -> dict[str, dict[str, str]]:
    """Unit and meaning of channels by name, as JSON values."""
    return {name: {"unit": channel.unit, "meaning": channel.meaning} for name, channel in known.items()}


def side_by_side(setups: Mapping[str, Setup]) -> dict[str, Channel]:
    """Channels of several axes by dotted names (``x.error``), of rows that hold one axis after the other."""
    return {
        f"{name}.{own.name}": own._replace(name=f"{name}.{own.name}", column=place * len(COLUMNS) + own.column)
        for place, (name, setup) in enumerate(setups.items())
        for own in channels(setup).values()
    }


def chosen(known: dict[str, Channel], names: list[str]) -> list[Channel]:
    """The channels of these names.  Raises ServiceError for an unknown channel, or too many of them."""
    for name in names:
        if name not in known:
            near = nearest(name, [*known]) or nearest(name.rpartition(".")[2], [*known])
            meant = f"did you mean {near}? " if near else ""
            raise ServiceError(f"no channel {name}; {meant}`stagectl scope --list` shows all")
    if not 0 < len(names) <= CHANNELS:
        raise ServiceError(f"{len(names)} channels; a scope shows 1 to {CHANNELS}")
    return [known[name] for name in names]


def level(channel: Channel, text: str) -> float:
    """A trigger's level in the ring's own unit, from a text with the channel's unit (or none where it has none).

    Raises ServiceError.
    """
    try:
        return parse(text, channel.unit) / channel.scale
    except UnitError as error:
        such = f"in {channel.unit}, such as '1 {channel.unit}'" if channel.unit else "without a unit"
        raise ServiceError(f"trigger level {text}: {error}; must be a number {such}") from error
