"""Variables of the FMU: the command, what the axis shows, and every parameter of the plant with its quantity."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from stagectl.config.stage_file import Setup
from stagectl.units import Quantity, quantities_of


class Variable(NamedTuple):
    """One variable; its value reference is its place in the list."""

    name: str
    start: float | int
    quantity: Quantity
    place: str  # in the C structure `model`
    causality: str = "parameter"
    variability: str = "fixed"

    @property
    def settable(self) -> int:
        """When it may be set: 2 always, 1 until the motion begins, 0 never."""
        when = {("input", "discrete"): 2, ("parameter", "tunable"): 2, ("parameter", "fixed"): 1}
        return when.get((self.causality, self.variability), 0)


_SIGNALS = (
    Variable("time", 0.0, Quantity("s", "[-inf, inf]", "time"), "time", "independent", "continuous"),
    Variable(
        "command", 0.0, Quantity("A", "[-inf, inf]", "current that the controller commands, held for a control period"),
        "command", "input", "discrete",
    ),
    Variable(
        "added_current", 0.0,
        Quantity("A", "[-inf, inf]", "added to the motor current: a disturbing effort over the force constant"),
        "noise.current", "input", "discrete",
    ),
)  # fmt: skip
_OUTPUTS = {  # name: place, quantity
    "position": ("x.position", Quantity("rad | m", "[-inf, inf]", "true position")),
    "velocity": ("x.velocity", Quantity("rad/s | m/s", "[-inf, inf]", "true velocity")),
    "measured": ("measured", Quantity("rad | m", "[-inf, inf]", "position as the encoder reports it")),
    "current": ("x.current", Quantity("A", "[-inf, inf]", "current in the motor")),
    "reported_current": ("reported", Quantity("A", "[-inf, inf]", "motor current as the drive reports it")),
    "friction": (
        "friction",
        Quantity("N m | N", "[-inf, inf]", "friction without its viscous part; positive against positive velocity"),
    ),
}
_START = {
    "start_position": Quantity("rad | m", "[-1e6, 1e6]", "true position at which it stands at the start"),
    "session_time": Quantity("s", "[0, 1e9]", "session clock at the start, on which the machine warms up"),
}


class Leaf(NamedTuple):
    """One number or array of the plant's parameters."""

    path: str
    value: Any
    quantity: Quantity | None  # None: a constant of the model
    effect: bool  # whether it belongs to an effect, which is neutral by default

    @property
    def storage(self) -> str:
        """Where the elements of an array are in the C structure `model`."""
        return self.path.replace(".", "_")


def leaves(block: Any, path: str = "", effect: bool = False, over: Quantity | None = None) -> Iterator[Leaf]:
    """All numbers in a block of parameters; `over` is the quantity of a harmonic, which is that of its amplitude."""
    quantities = quantities_of(type(block))
    for name, value in block._asdict().items():
        place, quantity = f"{path}{name}", quantities.get(name)
        optional = effect or name in block._field_defaults
        if hasattr(value, "_fields"):
            yield from leaves(value, f"{place}.", optional, quantity)
        else:
            yield Leaf(place, value, _amplitude(over, quantity) if name == "amplitude" else quantity, optional)


def _amplitude(over: Quantity | None, own: Quantity | None) -> Quantity | None:
    if over is None or own is None:
        return own
    return Quantity(over.unit, over.interval, f"{over.meaning}: {own.meaning}")


def variables(setup: Setup) -> list[Variable]:
    """All of them, in the order of their value references."""
    outputs = [
        Variable(name, 0.0, quantity, place, "output", "continuous") for name, (place, quantity) in _OUTPUTS.items()
    ]
    start = [Variable(name, 0.0, quantity, name) for name, quantity in _START.items()]
    return [*_SIGNALS, *outputs, *start, *(each for leaf in leaves(setup.stage) for each in _parameters(leaf))]


def _parameters(leaf: Leaf) -> Iterator[Variable]:
    """A number, or the elements of an array; what is an effect, or counts, is fixed once the motion has begun."""
    if leaf.quantity is None:
        return
    when = "fixed" if leaf.effect or isinstance(leaf.value, int) else "tunable"
    if isinstance(leaf.value, int | float):
        yield Variable(leaf.path, leaf.value, leaf.quantity, f"p.{leaf.path}", variability=when)
        return
    for number, value in enumerate(leaf.value):
        place = f"{leaf.storage}[{number}]"
        yield Variable(f"{leaf.path}[{number + 1}]", float(value), leaf.quantity, place, variability=when)
