"""Identification on machines that the project's estimator has never seen: ``tools/bench/identification_campaign.py``.

Each seed is a machine of `tests/foreign_plants`, one ordinary motion of it, and a log as CSV.  `stagectl.identify`
gets the log and the nominal stage file, in which only the encoder is right.  Its answer is compared with the truth and
with the intervals of two oracles (oracle.py) that know the friction law.  ``tests/foreign_plants/__init__.py`` defines
what is true; above all Coulomb friction and delay.

    nice python tools/bench/identification_campaign.py --captures 40
    nice python tools/bench/identification_campaign.py --captures 240 --json campaign.json
    nice python tools/bench/identification_campaign.py --seeds 17,30-35 --only dahl --keep captures

One process; Ctrl-C or SIGTERM ends it early, and it shows what it has.  `--json` keeps each answer as soon as it is
there; a second call with the same file goes on where the first was ended.  The exit code is 0 whatever the figures.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from campaign_scores import Outcome, show

import stagectl as sc
from tests.foreign_plants import capture_cases, friction, oracle
from tests.foreign_plants.nominal import STAGE_FILE

PARAMETERS = ("inertia", "viscous", "coulomb", "delay")


def main() -> None:
    """Capture, identify, compare, show."""
    chosen = _arguments()
    os.nice(10)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    outcomes = _kept(chosen.json)
    done = {(outcome.setting["seed"], outcome.setting["law"]) for outcome in outcomes}
    try:
        with tempfile.TemporaryDirectory(prefix="stagectl-") as folder:
            for seed in chosen.seeds or range(chosen.captures):
                setting = capture_cases.setting_of(seed, chosen.only)
                if (seed, setting.law) in done:
                    continue
                outcome = _outcome(setting, chosen.keep or Path(folder), chosen)
                outcomes.append(outcome)
                _keep(chosen.json, outcome)
                print(outcome.line(), file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("ended early", file=sys.stderr)
    show(outcomes)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="identification_campaign", description="Identify foreign machines.")
    parser.add_argument("--captures", type=int, default=240, metavar="N", help="seeds 0 to N - 1")
    parser.add_argument("--seeds", type=lambda text: list(_seeds(text)), metavar="3,17,20-25", help="exactly these")
    parser.add_argument("--only", choices=friction.LAWS, default="", help="every capture with this friction law")
    parser.add_argument("--method", default="simultaneous", help="of stagectl identify")
    parser.add_argument("--give-delay", action="store_true", help="give the true delay: what is left is the friction's")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="leave the CSVs and their truths there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="one answer a line; an existing file is continued")
    return parser.parse_args()


def _seeds(text: str) -> Iterator[int]:
    for part in text.split(","):
        first, _, last = part.partition("-")
        yield from range(int(first), int(last or first) + 1)


def _kept(path: Path | None) -> list[Outcome]:
    """The answers of an earlier call."""
    if path is None or not path.exists():
        return []
    return [Outcome(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines()]


def _keep(path: Path | None, outcome: Outcome) -> None:
    if path is not None:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(outcome._asdict()) + "\n")


def _outcome(setting: capture_cases.Setting, folder: Path, chosen: argparse.Namespace) -> Outcome:
    """One capture through everything."""
    capture = capture_cases.capture_of(setting)
    widths, truth = oracle.oracle(capture), capture.truth._asdict()
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / f"{setting.law}-{setting.seed}.csv"
    capture_cases.write(log, capture.columns)
    about = {"setting": setting._asdict(), "truth": truth}
    log.with_suffix(".json").write_text(json.dumps(about, indent=2), encoding="utf-8")
    stage = sc.load_stage(STAGE_FILE).changed({"encoder.counts_per_revolution": setting.counts})
    options = {"delay": truth["delay"]} if chosen.give_delay else {}
    begin = time.perf_counter()
    answer = _identified(stage, log, chosen.method, options)
    return Outcome(
        setting=about["setting"],
        truth=truth,
        oracle=widths._asdict(),
        seconds=time.perf_counter() - begin,
        **answer,
    )


def _identified(stage: Any, log: Path, method: str, options: dict[str, Any]) -> dict[str, Any]:
    """Intervals by parameter, or why there are none."""
    try:
        fit = sc.identify(stage, log, method=method, **options)
    except sc.StageError as error:
        reason = getattr(getattr(error, "reason", None), "value", type(error).__name__)
        return {"refused": str(reason), "words": str(error), "intervals": {}}
    except Exception as error:  # a crash is a finding of the campaign, not its end
        return {"refused": f"crash: {type(error).__name__}", "words": str(error), "intervals": {}}
    rows = {name: fit.parameters[name] for name in PARAMETERS if name in fit.parameters}
    intervals = {name: (float(row.value), float(row.low), float(row.high)) for name, row in rows.items()}
    return {"refused": "", "words": "\n".join(fit.notes), "intervals": intervals}


if __name__ == "__main__":
    main()
