"""``python -m stagectl_studies.baselines FOLDER OUT NAME...``: each NAME's answer.json and predictions below OUT."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from stagectl.gap.logs.session import Session
    from stagectl_studies.baselines.baseline_common import Answer


def main(arguments: Sequence[str] | None = None) -> None:
    """Answer a folder of captures."""
    parser = argparse.ArgumentParser(prog="python -m stagectl_studies.baselines", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="+", choices=("refit", "ladder", "sparse", "blackbox", "oracle"))
    parser.add_argument("--exclude", default="")
    parser.add_argument("--told", default="")
    given = parser.parse_args(arguments)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    answer(given.folder, given.out, given.names, (_list(given.exclude), _list(given.told)))


def _list(text: str) -> tuple[str, ...]:
    return tuple(name for name in text.split(",") if name)


def answer(folder: Path, out: Path, names: Sequence[str], lists: tuple[tuple[str, ...], tuple[str, ...]]) -> None:
    """Write the answers of `names`; `lists` = (excluded, told)."""
    from stagectl.gap.controller_check.command_check import check_command
    from stagectl.gap.logs.load_session import load
    from stagectl_studies.baselines import blackbox, ladder, oracle, refit, sparse
    from stagectl_studies.baselines.baseline_common import Answer, Ground, as_json, ground

    session, (excluded, known) = load([folder]), lists
    ways: dict[str, Callable[[Ground], Answer]] = {
        "refit": refit.refit,
        "ladder": ladder.ladder,
        "sparse": sparse.sparse,
        "blackbox": blackbox.blackbox,
        "oracle": lambda g: oracle.oracle(g, known),
    }
    agreement = check_command(session)
    g = ground(session, excluded) if agreement.agrees or not agreement.checked else None
    for name in names:
        baseline = Answer((), session.stage) if g is None else ways[name](g)
        place = out / name
        place.mkdir(parents=True, exist_ok=True)
        (place / "answer.json").write_text(json.dumps(as_json(baseline), indent=1) + "\n", encoding="utf-8")
        _predict(session, baseline, place / "predictions")


def _predict(session: Session, prediction: Answer, folder: Path) -> None:
    """A CSV for each held-out capture, as `gap diagnose --predictions` writes them."""
    from stagectl.gap.validation.rollouts import write_predictions
    from stagectl.recording.exports import write_columns

    if prediction.improved is not None:
        write_predictions(session, prediction.improved, folder)
        return
    folder.mkdir(exist_ok=True)
    held = [log for log in session.logs if log.held_out]
    for log, position in zip(held, prediction.predicted, strict=True):
        time = session.dt * np.arange(log.rows)
        write_columns(folder / Path(log.name).name, {"time_s": time, "position_rad": position})


if __name__ == "__main__":
    main()
