"""A service with a foreign drive: enable, a short move, disable; and what it says where that does not work."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stagectl.web.client import ControlError
from tests.service.serving import Served
from tests.zoo.bench import STANDSTILL, Result, drive, settle, until
from tests.zoo.diary import Diary
from tests.zoo.stage import write
from tests.zoo.table import Row
from tests.zoo.variants import named

_DISTANCE = "2 mm"


class ServedZoo(Served):
    """The service of the other tests; its drive is one of the zoo."""

    def __init__(self, folder: Path, row: Row) -> None:
        """With the stage file of a row in `folder`."""
        super().__init__(folder, stages=(str(folder / "stage.yaml"),))
        self.files = write(folder, named(row.variant), row.wire)
        self.said: list[str] = []
        self.unasked = False  # a fault was reset that nobody ordered to reset

    def tries(self, what: str, **body: Any) -> bool:
        """Whether the order was taken and carried out; a refusal is kept in `said`."""
        try:
            self.ask("POST", what, **body)
        except ControlError as error:
            self.said.append(str(error))
            return False
        return True

    @property
    def words(self) -> str:
        """All that a person has been told: answers, fault list, log."""
        with contextlib.suppress(ControlError):
            self.said += [str(entry) for entry in self.ask("GET", "faults")] + [str(self.axis())]
        return "\n".join((*self.said, self.log))


@contextlib.contextmanager
def served(folder: Path, row: Row) -> Iterator[tuple[ServedZoo, Diary]]:
    """A drive of the zoo and a service that knows its stage file."""
    machine = ServedZoo(folder, row)
    with drive(row.variant, machine.files) as diary:
        try:
            machine.start()
            yield machine, diary
        finally:
            machine.end()


def serve(folder: Path, row: Row) -> Result:
    """Enable, reset a fault if there is one, move, disable."""
    with served(folder, row) as (machine, diary):
        moved = _enabled(machine, row) and machine.tries("move", by={"axis": _DISTANCE}, speed="10 mm/s")
        if moved:
            machine.tries("disable")
        settle(diary)
        far = diary.moved()
        words = machine.words
    settle(diary)
    outcome = ("moves" if moved else "stops") if far > STANDSTILL else "refuses"
    return Result("resets a fault unasked" if machine.unasked else outcome, words, diary)


def _enabled(machine: ServedZoo, row: Row) -> bool:
    variant = named(row.variant)
    enabled = _enable(machine)
    if variant.fault_at_start:
        machine.unasked = enabled
        enabled = enabled or (machine.tries("faults/reset") and _enable(machine))
    return enabled and (not variant.start_counts or machine.tries("home"))


def _enable(machine: ServedZoo) -> bool:
    if not machine.tries("enable"):
        return False
    until(lambda: machine.axis()["state"] in ("standing", "fault", "disabled", "offline"), machine.axis)
    return str(machine.axis()["state"]) == "standing"
