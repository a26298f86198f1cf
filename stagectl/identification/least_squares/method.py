"""The method `least-squares`: one regression over all captures."""

from __future__ import annotations

from stagectl.config.stage_blocks import StageFile
from stagectl.identification.capture import Capture, IdentificationError, each
from stagectl.identification.least_squares.model import RegressionModel, reported_estimates
from stagectl.identification.least_squares.regression import FilteredRecord, filtered, solved
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
    IdentificationError where the captures do not determine the parameters.
    """
    model = RegressionModel(gravity, directions)
    constant = file.motor.force_constant

    def rows(capture: Capture) -> FilteredRecord:
        return filtered(capture.position, constant * capture.current, capture.dt, model)

    try:
        result = solved(list(each(captures, rows, progress)), model)
    except IdentificationError as error:
        raise error if error.capture else error.within(", ".join(capture.name for capture in captures)) from error
    values, covariance = result.solution
    estimates, correlation = reported_estimates(model, values, covariance, covariance)
    parameters = {
        name: Parameter.named(name, file.axis.kind, estimate.value, NORMAL_95 * estimate.deviation)
        for name, estimate in estimates.items()
    }
    details = {
        "force_residual_percent": result.residual_percent,
        "correlation": correlation.tolist(),
        "condition": result.condition,
    }
    changes = {f"mechanics.{name}": parameters[name].value for name in ("inertia", "viscous")}
    return IdentificationResult(parameters, details=details, notes=result.notes, changes=changes)
