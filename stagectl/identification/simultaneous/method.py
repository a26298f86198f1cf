"""The method `simultaneous`: inertia, viscous friction, rolling friction and delay from any motion with reversals.

::

    Kt i(t - tau) = J a + D w + b + friction(x)

The paper adjusts J and D by hand until the loop of ``T_d = Kt i - J a - D w`` over the position lies flat and only the
rolling friction remains.  Here the friction is a sum of many columns whose prior holds many laws, and the stage file's
values with their doubt are known before the data (`evidence`).  The intervals hold what the law, the delay and the
encoder leave open; what the motion does not excite keeps the interval of the stage file.

Source: Simultaneous Identification of Linear Parameters and Nonlinear Rolling Friction for Ball Screw Driven Stage,
section IV.B; the operators as in `kernels.friction`.
"""

from typing import Any

import numpy as np
from scipy import optimize

from stagectl.config.stage_blocks import StageFile
from stagectl.identification import thresholds
from stagectl.identification.capture import Array, Capture, IdentificationError, Refusal, accepted
from stagectl.identification.result import Characteristic, IdentificationResult, Note, Progress
from stagectl.identification.simultaneous import conditions, notes
from stagectl.identification.simultaneous.estimate import NAMES, Estimate, estimated, known_delay
from stagectl.identification.simultaneous.evidence import answered
from stagectl.identification.simultaneous.model import DelayPrior, problem
from stagectl.identification.simultaneous.regressors import ACCELERATION, FREE, VELOCITY, Part, part, thinned
from stagectl.identification.simultaneous.windows import knots
from stagectl.kernels.effects import TURN
from stagectl.units import ROTARY


def identify(
    captures: list[Capture],
    file: StageFile,
    delay: float | None = None,
    progress: Progress = lambda done, total: None,
    gravity: bool = False,
) -> IdentificationResult:
    """Parameters of `file`'s axis from all `captures` together; `delay` (s) is fitted where it is None.

    `delay` is the time by which the force follows the capture's current column, plus that by which the position is
    older than its row; it may be negative.  `gravity` adds terms in the sine and cosine of the angle.  Raises
    IdentificationError where no capture meets the paper's two conditions, or a linear axis is to have gravity in its
    angle.
    """
    if gravity and file.axis.kind != ROTARY:
        text = (
            f"--gravity is in the angle of a rotary axis, {file.name} is {file.axis.kind}: there gravity is the "
            "offset; leave it out"
        )
        raise IdentificationError(text, Refusal.UNKNOWN_OPTION, value=file.axis.kind, admissible=ROTARY)
    used, left_out = accepted(captures, lambda capture: conditions.checked(capture, file))
    progress(1, 5)
    known = known_delay(used, file, delay)
    parts = _parts(used, known, file)
    fitted = estimated(answered(problem(parts, file, known, gravity)))
    progress(3, 5)
    if any(rows.places.spans for rows in parts):
        at_rest = [rows.uncut for rows in parts]
        fitted = _narrower(fitted, estimated(answered(problem(at_rest, file, known, gravity))))
    progress(4, 5)
    result = _result(fitted, left_out)
    progress(5, 5)
    return result


def _narrower(moving: Estimate, all_rows: Estimate) -> Estimate:
    """The estimate of all rows where it is the narrower one and the rows in motion agree with it, else theirs.

    Where the friction law follows a standing axis, too, both find the same, and all rows know more.  Where it does not,
    all rows are biased, and those in motion are not (J. A. Hausman, Econometrica 46(6), 1978).
    """
    pairs = [(moving.parameters[name], all_rows.parameters[name]) for name in NAMES]
    agree = all(few.low <= more.value <= few.high for few, more in pairs)
    return all_rows if agree and all(more.half <= few.half for few, more in pairs) else moving


def _parts(captures: list[Capture], delay: DelayPrior, file: StageFile) -> list[Part]:
    """Rows of all captures on which the friction's state is known; at most `MOST_ROWS`."""
    room = float(np.abs(delay.nodes).max()) * thresholds.DELAY_ROOM
    longest = thresholds.FORGOTTEN * max(float(np.ptp(capture.position)) for capture in captures)
    turn = TURN if file.axis.kind == ROTARY else file.mechanics.pitch
    parts = [part(capture, knots(capture), longest, room, turn) for capture in captures]
    parts = thinned([rows for rows in parts if rows.rows > 0], thresholds.MOST_ROWS)
    number = sum(rows.rows for rows in parts)
    if number < thresholds.FIT_LEAST_ROWS:
        raise IdentificationError(
            f"{captures[0].name}: {number} rows are left once the friction's state is known, fewer than "
            f"{thresholds.FIT_LEAST_ROWS}; record longer: a second of a motion there and back is enough",
            Refusal.TOO_SHORT,
            capture=captures[0].name,
            value=number,
            admissible=f"[{thresholds.FIT_LEAST_ROWS}, inf)",
        )
    return parts


def _result(p: Estimate, before: list[Note]) -> IdentificationResult:
    table = _table(p)
    changes: dict[str, Any] = {
        "mechanics.inertia": p.parameters["inertia"].value,
        "mechanics.viscous": p.parameters["viscous"].value,
        "friction": table.block,
    }
    withheld = notes.withheld(p)
    return IdentificationResult(
        p.parameters,
        table,
        _details(p),
        (*notes.written(p), *before, *withheld.values()),
        {name: value for name, value in changes.items() if name not in withheld},
    )


def _table(p: Estimate) -> Characteristic:
    """Stop operators whose force along the path is nearest to the friction found, with its Coulomb friction.

    The reversal table reaches to 1.1 times the displacement at which the last element slips.
    """
    gram, place = p.problem.columns.T @ p.problem.columns, p.problem.groups["operators"]
    triangle = np.linalg.cholesky(gram[place, place] + thresholds.COLUMN_RIDGE * np.diag(np.diag(gram)[place])).T
    aim = np.linalg.solve(triangle.T, gram[place, FREE:] @ p.theta[FREE:])
    weight, _ = optimize.nnls(triangle, aim)
    carrying = weight > thresholds.CARRYING * weight.sum()
    if not np.any(carrying):
        carrying[len(weight) // 2] = weight[len(weight) // 2] = 1.0
    slip, weight = p.problem.shapes.slip[carrying], weight[carrying]
    weight = weight * (p.parameters["coulomb"].value / weight.sum())
    return Characteristic.over(np.linspace(0.0, 2.2 * float(slip[-1]), 221), weight, slip)


def _details(p: Estimate) -> dict[str, Any]:
    force = p.residual + p.problem.columns @ p.theta
    names = list(NAMES if p.delay_fitted else NAMES[:-1])
    deviations = np.sqrt(np.diag(p.covariance))[: len(names)]
    correlation = p.covariance[: len(names), : len(names)] / np.outer(deviations, deviations)
    return {
        "force_residual_percent": 100.0 * float(np.linalg.norm(p.residual) / np.linalg.norm(force)),
        "rows": len(force),
        "laws": [(law.name, law.criterion - p.problem.laws[0].criterion) for law in p.problem.laws],
        "scales": p.answer.best.scales,
        "worth_rows": len(force) / p.answer.worth,
        "form_share": p.answer.form_share,
        "captures": [rows.capture.name for rows in p.problem.parts],
        "current_column": sorted({rows.capture.current_column for rows in p.problem.parts}),
        "delay_fitted": p.delay_fitted,
        "prior": p.prior,
        "ripple": p.ripple,
        "correlation": correlation.tolist(),
        "identifiability": {
            "names": names,
            "correlation": correlation.tolist(),
            "per_delay": dict(zip(names, p.per_delay.tolist(), strict=False)),
        },
        "curves": _curves(p, force),
    }


def _curves(p: Estimate, force: Array) -> dict[str, list[float]]:
    """Columns of the first capture that the figures draw: at most `DRAWN_ROWS` rows."""
    first, columns = p.problem.parts[0], p.problem.columns
    rows = slice(0, min(first.rows, thresholds.DRAWN_ROWS))
    index = first.places.samples[rows]
    curves = {
        "time": first.capture.time[index],
        "position": first.capture.position[index],
        "force": force[rows],
        "acceleration": columns[rows, ACCELERATION],
        "velocity": columns[rows, VELOCITY],
        "friction": columns[rows, FREE:] @ p.theta[FREE:],
        "residual": p.residual[rows],
    }
    return {name: np.asarray(values).tolist() for name, values in curves.items()}
