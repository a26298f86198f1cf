"""The methods by the names that a user types, and the JSON form of their results."""

import importlib
import inspect
from collections.abc import Mapping, Sequence
from typing import Any

from stagectl.compensation.rolling import FORMS
from stagectl.config.friction_laws import friction_of, law_in
from stagectl.config.stage_blocks import StageFile
from stagectl.config.stage_file import Setup
from stagectl.identification import thresholds
from stagectl.identification.capture import Capture, IdentificationError, Refusal
from stagectl.identification.catalogue import METHODS, Method, listed
from stagectl.identification.result import Characteristic, IdentificationResult, Note, Progress, Topic
from stagectl.problem import nearest
from stagectl.typed_json import plain
from stagectl.units import unit_on

_INPUTS = ("captures", "file", "progress")  # arguments of a method that are no options


def identify(
    name: str, captures: Sequence[Capture], file: StageFile, progress: Progress, options: Mapping[str, Any]
) -> IdentificationResult:
    """The result of the method `name`; `options` by the names of its arguments, None and False where not given.

    Raises IdentificationError where the method has no such option, or the captures do not determine its parameters.
    """
    solve = importlib.import_module(f"stagectl.identification.{METHODS[name].module}").identify
    known = inspect.signature(solve).parameters
    given = {option: value for option, value in options.items() if value is not None and value is not False}
    if foreign := [option for option in given if option not in known]:
        if near := nearest(foreign[0], [one for one in known if one not in _INPUTS]):
            reason = f"{foreign[0]} is not an option of {name}: did you mean {near}?"
            raise IdentificationError(reason, Refusal.UNKNOWN_OPTION, value=foreign[0], admissible=near)
        own = [f"--{option}" for option in options if option in known]
        text = f"--{foreign[0]} is not an option of {name}; {'it has ' + ', '.join(own) if own else 'leave it out'}"
        raise IdentificationError(text, Refusal.UNKNOWN_OPTION, value=foreign[0], admissible=", ".join(own))
    result: IdentificationResult = solve(list(captures), file, progress=progress, **given)
    return result


def chosen(name: str) -> Method:
    """The method of that `name`.

    Raises IdentificationError, naming all methods, where there is none.
    """
    if name not in METHODS:
        near = nearest(name, list(METHODS))
        raise IdentificationError(
            f"method {name}: did you mean {near}?"
            if near
            else "\n  ".join([f"method {name}; must be one of", *listed()]),
            Refusal.UNKNOWN_OPTION,
            value=name,
            admissible=", ".join(METHODS),
        )
    return METHODS[name]


def result(
    name: str, setup: Setup, captures: Sequence[Capture], estimate: IdentificationResult, left: Sequence[str]
) -> dict[str, Any]:
    """The result `estimate` as JSON values; `left` are the captures that were held out."""
    common = ("force_residual_percent", "correlation", "condition")
    of_captures = {note for capture in captures for note in capture.notes}
    return {
        "method": name,
        "stage": setup.file.name,
        "parameters": {key: plain(parameter) for key, parameter in estimate.parameters.items()},
        "table": _table(estimate.table, setup) if estimate.table is not None else None,
        "identifiability": plain(_identifiability(estimate)),
        **{key: plain(estimate.details[key]) for key in common if key in estimate.details},
        "captures": [_capture(capture) for capture in captures],
        "held_out": list(left),
        "notes": [str(note) for note in (*estimate.notes, *_tied(estimate)) if note not in of_captures],
        "changes": plain(estimate.changes),
        "details": plain({key: value for key, value in estimate.details.items() if key != "identifiability"}),
    }


def _identifiability(estimate: IdentificationResult) -> Any:
    """What the method itself reports, else the correlations of its parameters."""
    reported, matrix = estimate.details.get("identifiability"), estimate.details.get("correlation")
    if reported is not None or matrix is None or len(matrix) > len(estimate.parameters):
        return reported
    return {"names": list(estimate.parameters)[: len(matrix)], "correlation": matrix}


def _tied(estimate: IdentificationResult) -> list[str]:
    """Notes on pairs of parameters that are highly correlated, where the method does not report them itself."""
    if "identifiability" in estimate.details:
        return []
    reported = _identifiability(estimate) or {"names": [], "correlation": []}
    names, matrix = reported["names"], reported["correlation"]
    pairs = [(names[j], names[k], matrix[j][k]) for j in range(len(names)) for k in range(j)]
    return [
        Note(
            Topic.TIED,
            f"{first} and {second}: tied to each other in this motion (correlation {r:+.2f}), each known no better "
            "than the other",
        )
        for first, second, r in pairs
        if abs(r) > thresholds.TIED
    ]


def _capture(capture: Capture) -> dict[str, Any]:
    return {
        "name": capture.name,
        "rows": len(capture.time),
        "duration": capture.dt * len(capture.time),
        "dt": capture.dt,
        "current": capture.current_column,
        "notes": [str(note) for note in capture.notes],
    }


def _table(table: Characteristic, setup: Setup) -> dict[str, Any]:
    length, force = (unit_on(setup.file.axis.kind, units) for units in ("rad | m", "N m | N"))
    units = {"displacement": length, "force": force, "weight": force, "slip": length}
    return {**plain(table), "units": units}


def with_compensators(
    result: IdentificationResult, method: str, acting: str | None, compared: Sequence[str]
) -> IdentificationResult:
    """`result` whose changes hold the compensator that is `acting`, and those to be `compared`, by their names.

    Raises IdentificationError for a name that is none, and where `method` writes no friction into the stage file.
    """
    wanted = [*([acting] if acting else []), *compared]
    if not wanted:
        return result
    check_forms(wanted)
    if "friction" not in result.changes:
        raise IdentificationError(
            f"{method} writes no friction into the stage file, so no compensator is made of it; take simultaneous, "
            "low-speed or friction-models, and a motion with reversals",
            Refusal.UNKNOWN_OPTION,
            value=", ".join(wanted),
        )
    return result._replace(changes={**result.changes, **_blocks(result, acting, compared)})


def check_forms(names: Sequence[str]) -> None:
    """Raises IdentificationError for a name that no compensator has: before the work that ends with one."""
    for name in names:
        if name not in FORMS:
            text = f"no compensator {name!r} can be made of a friction law; must be one of {', '.join(FORMS)}"
            raise IdentificationError(text, Refusal.UNKNOWN_OPTION, value=name, admissible=", ".join(FORMS))


def _blocks(result: IdentificationResult, acting: str | None, compared: Sequence[str]) -> dict[str, Any]:
    from stagectl.compensation import derived  # scipy's parts, which few calls need

    friction = friction_of(law_in(result.changes["friction"]))
    blocks: dict[str, Any] = {}
    if acting:
        blocks["compensation"] = derived.block(acting, friction)
    for name in compared:
        blocks[f"compensators.{name}"] = {k: v for k, v in derived.block(name, friction).items() if k != "form"}
    return blocks
