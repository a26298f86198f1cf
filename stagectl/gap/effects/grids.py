"""Grids on which the shapes of effects are searched, and sizes at which their columns are taken.

All are chosen, not derived: each grid is as coarse as its neighbours still find an effect that lies between them.
"""

from collections.abc import Sequence

from stagectl.kernels.constants import FIRST_ORDER

# Share by which a limit lies below the largest current (voltage) of the logs.  A drive that did reach its limit gave
# it as its largest value, up to the noise of the measurement: hence the smallest one.
LIMIT_DEPTHS = (0.01, 0.05, 0.25)
SPEED_EXPONENTS = (0.5, 2.0)  # grease and bearings; drag
STRIBECK_SPEEDS = (0.001, 0.004, 0.015, 0.06, 0.2)  # of the largest speed
LOOP_DAMPINGS = (FIRST_ORDER, 0.7)  # of the current loop: of first order, and with the overshoot of a usual design
LOOP_DAMPING = (0.3, FIRST_ORDER)  # between which it is refined
DWELL_SLIPS = (0.15, 0.4, 1.0)  # of the rolling zone: about the mean slip of its elements, and 2.5 times less and more
DWELL_TIMES = (0.03, 0.2)  # s
FRICTION_LAGS = (0.003, 0.012)  # s
WARMING_TIMES = (30.0, 100.0, 300.0, 1000.0)  # s
MOST_STEP_TIMES = 24  # instants of the session at which a step of the friction is tried
CABLE_SLIPS = (0.02, 0.05, 0.12, 0.3)  # of half the stroke
BACKLASH_GAPS = (0.04, 0.1, 0.25, 0.6, 1.5)  # of the rolling zone
# Hz; belts and robot joints ring at tens of Hz, a ball screw at hundreds.
COMPLIANCE_FREQUENCIES = (8.0, 12.0, 18.0, 27.0, 40.0, 56.0, 80.0, 120.0, 180.0, 270.0, 400.0, 600.0, 900.0, 1350.0)
BACKLASH_FREQUENCIES = (150.0, 800.0)  # Hz, of the drive train when the gap is closed
SOFTEST_TRAIN = 20.0  # Hz; a drive train rings no lower when its gap is closed
BASE_FREQUENCIES = (8.0, 11.0, 15.0, 21.0, 29.0, 40.0, 55.0)  # Hz
LOAD_SHARE = 0.3  # typical, of the moving inertia
BASE_RATIO = 0.05  # typical, of the moving mass over that of the base
SAME_FREQUENCY = 0.05  # relative distance below which a frequency of the grid is one that the logs show
_ARCSECOND = 7.7e-7  # of a pitch of one turn
# Of a pitch: once per turn, once per signal period.  Catalogues of motor encoders say 20 to 60 arcsec once per turn for
# optical ones, up to 500 for inductive ones and more for magnetic ones.
ENCODER_ERRORS = (60.0 * _ARCSECOND, 3.0 * _ARCSECOND)
COGGING_OF_EFFORT = 0.1  # of the largest effort: typical cogging of a bare motor, whose friction is smaller than it
HIGHEST = 2500.0  # Hz, of any resonance


def told_by_rows(frequencies: Sequence[float], dt: float) -> tuple[float, ...]:
    """Those of `frequencies` (Hz) whose period is no shorter than that of the rows, `dt` (s).

    What swings faster has come to rest between two rows: no log tells one such frequency from the next.
    """
    return tuple(frequency for frequency in frequencies if frequency <= highest_told(dt))


def highest_told(dt: float) -> float:
    """The highest frequency (Hz) that rows every `dt` (s) tell, up to which a resonance is refined as well."""
    return min(1.0 / dt, HIGHEST)


def no_faster_than_rows(frequencies: Sequence[float], dt: float) -> tuple[float, ...]:
    """`frequencies` (Hz), each no higher than the rows tell: of what is part of a model all the same."""
    return tuple(sorted({min(frequency, max(highest_told(dt), SOFTEST_TRAIN)) for frequency in frequencies}))
