"""The way of a drive to its first power and beyond: `drive accept` with the page that it leaves, and `commission`."""

import sys
import time
from pathlib import Path
from typing import Annotated

from stagectl.cli.options import Channel, Json, MachineOfTheDay, Simulate, StageArgument, amperes, argument, option
from stagectl.cli.show import console, emit, without_compiler
from stagectl.extras import require
from stagectl.units import StageError


def commission(
    stage: StageArgument,
    person: Annotated[str, option("--person NAME", "Name of the person who confirms each step and signs.")] = "",
    yes: Annotated[bool, option("--yes", "Ask nobody; on a virtual drive or a model only.")] = False,
    again: Annotated[str, option("--again STEP", "Do this step and those after it once more.")] = "",
    simulate: Simulate = False,
    machine_of_the_day: MachineOfTheDay = 0,
    seed: Annotated[int, option("--seed", "Seed of noise and order.", min=0, max=2**31 - 1)] = 1,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Commission an axis: probe, accept, identify, tune, compensate, close the gap, compare.

    Each step asks before it moves, and shows its page. It also changes the stage file: `gap close --back` undoes the
    last change. STAGE.commission.json lists what is done; type the same command again to continue.

    Example: stagectl commission my-stage.yaml --yes --person "A. Turing" --machine-of-the-day 7
    """
    require("report", "the pages")
    from stagectl.api.commission import Commissioning
    from stagectl.api.commission import commission as perform
    from stagectl.config.stage_file import load_stage
    from stagectl.workflows.acceptance.protocol import virtual

    is_virtual = simulate or virtual(load_stage(stage, designed=False))
    if (yes or machine_of_the_day) and not is_virtual:
        raise StageError("--yes and --machine-of-the-day are for a virtual drive: a person must let each step happen")
    going = Commissioning(
        path=Path(stage),
        simulated=simulate,
        person=person,
        seed=seed,
        machine=machine_of_the_day,
        channel=channel,
        progress=True,
        say=console.print,
        go_ahead=lambda name, words: agreed(name, words, yes),
    )
    result = perform(going, again)
    console.print(
        f"commissioned: {result['steps']['compare']['words']}; {result['machine_time']:.0f} s of machine time"
    )
    emit(result, json)


Key = Annotated[
    Path | None, option("--key FILE", "Key of the signature (HMAC-SHA-256).", envvar="STAGECTL_ACCEPTANCE_KEY")
]
_WORD = "go"


def accept(
    stage: StageArgument,
    person: Annotated[
        str, option("--person NAME", "Name of the person who confirms each step and signs the page.")
    ] = "",
    current: Annotated[str | None, option("--current CURRENT", "Largest current of all tests, e.g. '1.2 A'.")] = None,
    output: Annotated[Path | None, option("--output -o FILE", "The page, .html and .json; default: by date.")] = None,
    key: Key = None,
    yes: Annotated[bool, option("--yes", "Ask nobody; on a virtual drive only.")] = False,
    channel: Channel = None,
    json: Json = None,
) -> None:
    """Try a drive before its first real motion, step by step, and sign a page with the measured stop distances.

    Exit 1 where a step failed or was skipped: then the axis is not accepted.

    Example: stagectl drive accept config/ball-screw.yaml --yes --person "A. Turing" -o acceptance
    """
    without_compiler()
    require("report", "the signed page")
    from stagectl.config.stage_file import load_stage, on_channel
    from stagectl.workflows.acceptance.page import BUT_VIRTUAL, free_places, write_pages
    from stagectl.workflows.acceptance.protocol import Signatory, virtual
    from stagectl.workflows.acceptance.protocol import accept as perform
    from stagectl.workflows.acceptance.result import read_key, signed

    setup = on_channel(load_stage(stage, designed=False), channel)
    if yes and not virtual(setup):
        raise StageError("--yes is for a virtual drive only: with a real one a person must let each step happen")
    secret = None if key is None else read_key(key)
    path = output or Path(f"acceptance-{time.strftime('%Y%m%d-%H%M%S')}")
    free_places(path)  # before the first step: what was tried must not be lost
    result = perform(
        setup,
        Signatory(person, lambda step, words: agreed(step.name, words, yes)),
        console.print,
        amperes("current", current),
    )
    signature = signed(result, secret)
    for file in write_pages(result, signature, path):
        console.print(f"wrote {file}")
    accepted = f"accepted{BUT_VIRTUAL if result.virtual else ''}"
    console.print(accepted if result.accepted else "NOT ACCEPTED: do not run this axis")
    emit(signature, json, result.accepted)


def verify(
    page: Annotated[Path, argument("PAGE.json", "What `drive accept` wrote.")], key: Key = None, json: Json = None
) -> None:
    """Check that an acceptance has not changed since it was signed, and that it accepts the axis.

    Example: stagectl drive verify acceptance.json
    """
    from stagectl.workflows.acceptance.result import read_key
    from stagectl.workflows.acceptance.result import verify as check

    content = check(page, None if key is None else read_key(key))
    accepted = bool(content["accepted"])
    state = "accepted" if accepted else "NOT ACCEPTED"
    console.print(f"{content['stage']}: {state}, {content['person']}, {content['date']}; unchanged since")
    emit(content, json, accepted)


def agreed(name: str, words: str, yes: bool) -> bool:
    """Whether a person types the word; any other word, or the end of the input, is a no.  `yes`: nobody is asked."""
    console.print(f"{name}: {words}")
    if yes:
        return True
    console.print(f"type {_WORD} and Enter to let it happen; anything else ends it here")
    return sys.stdin.readline().strip() == _WORD
