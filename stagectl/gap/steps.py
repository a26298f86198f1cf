"""The steps of a diagnosis, and the time that each of them takes."""

import enum
import time
from collections.abc import Callable


class Step(enum.StrEnum):
    """The steps of a diagnosis, in their order; the value is its name in the answer and on the screen."""

    CONTROLLER = "controller: the command recomputed"
    BASELINE = "base model refitted"
    SENSITIVITIES = "effects simulated along the measured paths"
    SEARCH = "search"
    PARAMETERS = "parameters"
    LOCALISATION = "where"
    VALIDATION = "held-out runs simulated"
    EXPERIMENT = "next experiment"


# In %, where each step begins in a whole diagnosis; medians of 20 on the recommended battery.  Only a display reads it.
BEGINS = {
    Step.CONTROLLER: 0,
    Step.BASELINE: 1,
    Step.SENSITIVITIES: 8,
    Step.SEARCH: 41,
    Step.PARAMETERS: 82,
    Step.LOCALISATION: 94,
    Step.VALIDATION: 96,
    Step.EXPERIMENT: 99,
}

Progress = Callable[[str], None]  # called with each `Step` as it begins, and with a line for what happens within it


def in_percent(update: Callable[..., object]) -> Progress:
    """What shows a diagnosis as `update` (percent done, 100, words): a line between two steps next to the earlier."""
    reached = 0

    def report(message: str) -> None:
        nonlocal reached
        reached = BEGINS[message] if isinstance(message, Step) else reached
        update(reached, 100, str(message))

    return report


class StepTimer:
    """Seconds of each step; passes on what is being done."""

    def __init__(self, progress: Progress, clock: Callable[[], float] = time.monotonic) -> None:
        self._progress, self._clock = progress, clock
        self._began: list[tuple[Step, float]] = []

    def begin(self, step: Step) -> None:
        """The step begins, and the one before ends."""
        self._began.append((step, self._clock()))
        self._progress(step)

    @property
    def seconds(self) -> tuple[tuple[str, float], ...]:
        """Name and duration of each step so far; the last one ends now."""
        ends = [*(began for _, began in self._began[1:]), self._clock()]
        return tuple((step.value, end - began) for (step, began), end in zip(self._began, ends, strict=True))
