"""One member of the friction family fitted alone, as `friction-models` fits each of them."""

from __future__ import annotations

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import standard_errors
from stagectl.identification.capture import Capture
from stagectl.identification.friction import comparison
from stagectl.identification.friction.fit import fitted, prepared
from stagectl.identification.friction.method import _result
from stagectl.identification.result import IdentificationResult
from stagectl.identification.simultaneous.estimate import known_delay


def fit_member(name: str, captures: list[Capture], file: StageFile, delay: float | None = 0.0) -> IdentificationResult:
    """The member `name`, with `delay` (s) between current and position; None: its own."""
    basis = comparison.Basis(prepared(captures, file, known_delay(captures, file, delay)), captures, file)
    fit = fitted(name, basis.data)
    result, independent = _result(fit, basis), standard_errors.independent(fit.residual)
    summary = comparison.summary(fit, basis)
    return result._replace(details={**result.details, **summary, "bic": comparison.bic(fit, independent)})
