"""Values by their names, as an option of a command line holds them."""

from stagectl.problem import Problem, ProblemKind
from stagectl.units import StageError


def names_of(options: list[str] | None) -> list[str]:
    """Names from options that may each hold several."""
    return [name.strip() for text in options or () for name in text.split(",") if name.strip()]


def pairs(option: str, text: str, form: str, example: str) -> dict[str, str]:
    """The entries of ``a=1,b=2``, the text of an `option` whose entries are of this `form`, such as ``NAME=VALUE``.

    Raises StageError where an entry is of another form, or written twice.
    """
    found: dict[str, str] = {}
    for entry in text.split(","):
        name, _, value = (part.strip() for part in entry.partition("="))
        if not name or not value or name in found:
            reason = f"{option} {text}: {entry!r} must be {form}, each name once, such as {example}"
            raise StageError(Problem(reason, ProblemKind.SYNTAX))
        found[name] = value
    return found
