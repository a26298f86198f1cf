"""Experiments that no trajectory can do: a change by hand, or a reading."""

from __future__ import annotations

from typing import NamedTuple

from stagectl.gap.effects.library import excited_by


class ManualExperiment(NamedTuple):
    """A change by hand, or a reading, in words for the user."""

    name: str
    separates: str  # effects, in words
    words: str  # what to do
    duration: float  # s, about

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that it separates."""
        return excited_by(self.name)


MANUAL = (
    ManualExperiment(
        "added mass",
        "inertia and force constant: only one of them changes with a mass that is known",
        "Weigh a mass of 20 to 50 % of the moving one, screw it to the table, and record the sine of 1.6 Hz again.  "
        "The inertia that is found must grow by that mass; if it grows by more or less, the force constant is off by "
        "the same share.",
        900.0,
    ),
    ManualExperiment(
        "hanging weight",
        "force constant and the common scale of inertia and friction, by a force that is known",
        "Hang a known weight over a pulley on the table, or tilt the axis by a known angle, and record the slow scan: "
        "the constant part of the current times the force constant must be that force.",
        900.0,
    ),
    ManualExperiment(
        "back-EMF",
        "force constant, without the current: in SI it is the volts per speed of the open motor",
        "Disconnect the motor, move the axis at a known speed, and read the voltage between two phases.",
        600.0,
    ),
    ManualExperiment(
        "second sensor",
        "errors of the encoder and of the screw from forces: a motor's encoder does not see its screw's lead error",
        "Put a laser interferometer or a linear scale on the table and log it along with the slow scan both ways.",
        3600.0,
    ),
    ManualExperiment(
        "power-off reading",
        "offset of the current sensor from a force on the axis",
        "Read the drive's current for ten seconds with its power stage off: what it shows is the sensor's offset.",
        60.0,
    ),
    ManualExperiment(
        "timestamps",
        "a dead time that varies from one that does not",
        "Let the drive stamp the frames it receives, or watch SYNC and the current on an oscilloscope: the spread is "
        "the jitter, the mean less the modelled delay the dead time.",
        600.0,
    ),
    ManualExperiment(
        "object dictionary",
        "steps of the command, by what the drive reports of itself",
        "Read rated current, current limits, gains of the current loop and the scale of the command object from the "
        "drive's object dictionary or data sheet, and compare them with the stage file.",
        300.0,
    ),
    ManualExperiment(
        "status word",
        "a current limit from a voltage limit",
        "Log the statusword and the DC voltage along with the sine at the current limit: bit 11 of the statusword says "
        "that an internal limit is active.",
        300.0,
    ),
    ManualExperiment(
        "measured elsewhere on the base",
        "a base that moves from a compliance within the axis",
        "Put an accelerometer on the base and record step and settle: what it shows at the frequency in question is "
        "the base.",
        1800.0,
    ),
)
