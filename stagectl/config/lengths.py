"""Conversion of lengths and angles on an axis: positions of a ball screw, a rotary axis, may be written as lengths."""

import math
from typing import NamedTuple

from stagectl.problem import Problem, ProblemKind
from stagectl.units import LINEAR, ROTARY, Quantity, UnitError, parse

_LENGTH_WITHOUT_LEAD = Problem(
    "a length on an axis without a lead: give axis.lead, or write an angle", ProblemKind.UNIT
)


class Lengths(NamedTuple):
    """The axis, as far as lengths and angles depend on it."""

    axis: str = LINEAR
    lead: float = 0.0  # m per revolution, 0 where there is none
    angular: bool = False  # travel itself is an angle: a trajectory on a rotary axis without lead

    def unit_of(self, quantity: Quantity | None) -> str:
        """SI unit of a field on this axis."""
        unit = quantity.unit_for(self.axis) if quantity else ""
        return unit.replace("m", "rad", 1) if self.angular and _family(unit) == "m" else unit

    def angle_per_length(self, unit: str) -> float:
        """Angle (rad) of a metre of table travel where `unit` is that of an angle; 0 where no lead converts it."""
        if _family(unit) != "rad" or self.axis != ROTARY or not self.lead:
            return 0.0
        return 2.0 * math.pi / self.lead

    def number(self, text: str, unit: str) -> float:
        """The value of `text` in `unit`, converted through the lead where that is needed.  Raises UnitError."""
        try:
            return parse(text, unit)
        except UnitError:
            value = self._through_lead(text, unit)
            if value is None:
                raise
            return value

    def _through_lead(self, text: str, unit: str) -> float | None:
        """A table length where an angle is expected, or an angle where a length is; None where `text` is neither.

        Raises UnitError where its number cannot be used.
        """
        family, lead = _family(unit), self.lead / (2.0 * math.pi)
        if family not in ("rad", "m") or self.axis != ROTARY:
            return None
        try:
            value = parse(text, unit.replace(family, "m" if family == "rad" else "rad", 1))
        except UnitError as error:
            if error.problems[0].kind is ProblemKind.VALUE:  # the unit fits, the number does not
                raise
            return None
        if lead > 0.0:
            return value / lead if family == "rad" else value * lead
        if family == "rad":
            raise UnitError(_LENGTH_WITHOUT_LEAD)
        return None


def _family(unit: str) -> str:
    return unit.split("/")[0]
