"""How far a reproduction has come: steps that take known times, so that the time left can be told."""

from collections.abc import Callable, Mapping

Tell = Callable[[int, int], None]  # done, total


class Course:
    """Steps in the order in which they come, each with what it takes (s, on two slow cores)."""

    def __init__(self, steps: Mapping[str, float], tell: Tell) -> None:
        self._steps, self._tell = dict(steps), tell
        self._done = 0.0
        self._step = 0.0
        self._report(0.0)

    def begin(self, name: str) -> Tell:
        """The step `name` begins; the one before is done.  Returns what tells its own progress (done, total)."""
        names = list(self._steps)
        self._done = sum(self._steps[word] for word in names[: names.index(name)])
        self._step = self._steps[name]
        self._report(0.0)
        return lambda done, total: self._report(self._step * min(done / max(total, 1), 1.0))

    def finish(self) -> None:
        """All steps are done."""
        self._done = sum(self._steps.values())
        self._report(0.0)

    def _report(self, part: float) -> None:
        self._tell(round(100.0 * (self._done + part)), round(100.0 * sum(self._steps.values())))
