"""The method `least-squares`: one regression over all captures.

Least squares take the acceleration as exact.  Noise that is in it and not in the force makes the inertia smaller: of
the encoder (`filtering` keeps it small), or of a torque that no current shows and of a disk that is not centred, which
only the regression sees.  It lies above the motion's frequencies, so the cut-off is halved as long as half of it gives
an interval that excludes the inertia found.

Source: a specification test as in J. A. Hausman, Econometrica 46(6), 1978.
"""

from collections.abc import Callable

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Capture, IdentificationError, accepted, each
from stagectl.identification.filtering import design_filter
from stagectl.identification.least_squares.regression import (
    FilteredRecord,
    RegressionModel,
    RegressionResult,
    filtered,
    solved,
)
from stagectl.identification.result import IdentificationResult, Parameter, Progress
from stagectl.identification.thresholds import NORMAL_95


def identify(
    captures: list[Capture],
    file: StageFile,
    progress: Progress = lambda done, total: None,
    gravity: bool = False,
    directions: bool = False,
) -> IdentificationResult:
    """Inertia, viscous and Coulomb friction and offset; the force is the force constant times the current.

    `gravity` adds terms in the sine and cosine of the position, `directions` a friction for each direction.  Raises
    IdentificationError where the captures do not determine the parameters; one that is too short is left out.
    """
    model = RegressionModel(gravity, directions)
    constant = file.motor.force_constant
    used, left_out = accepted(captures, _long_enough)

    def at(share: float, told: Progress) -> RegressionResult:
        def rows(capture: Capture) -> FilteredRecord:
            return filtered(capture.position, constant * capture.current, capture.dt, model, share)

        return solved(list(each(used, rows, told)), model)

    try:
        result = _without_noise(at(1.0, progress), lambda share: at(share, lambda done, total: None))
    except IdentificationError as error:
        raise error if error.capture else error.within(", ".join(capture.name for capture in used)) from error
    parameters = {
        name: Parameter.named(name, file.axis.kind, estimate.value, NORMAL_95 * estimate.deviation)
        for name, estimate in result.estimates.items()
    }
    details = {
        "force_residual_percent": result.residual_percent,
        "correlation": result.correlation.tolist(),
        "condition": result.condition,
    }
    changes = {f"mechanics.{name}": parameters[name].value for name in ("inertia", "viscous")}
    return IdentificationResult(parameters, details=details, notes=(*result.notes, *left_out), changes=changes)


def _long_enough(capture: Capture) -> Capture:
    """The same.  Raises IdentificationError where it is too short for the filter that suits its encoder."""
    design_filter(capture.position, capture.dt)
    return capture


def _without_noise(found: RegressionResult, at: Callable[[float], RegressionResult]) -> RegressionResult:
    """`found`, or the regression `at` a share of its cut-off from which on the inertia grows no more.

    Noise of the position makes the inertia smaller, and less of it makes it larger; what makes it smaller with a lower
    cut-off is no noise.
    """
    share = 0.5
    while True:
        try:
            lower = at(share)
        except IdentificationError:  # the records are too short to tell
            return found
        inertia = lower.estimates["inertia"]
        if inertia.value - found.estimates["inertia"].value <= NORMAL_95 * inertia.deviation:
            return found
        found, share = lower, 0.5 * share
