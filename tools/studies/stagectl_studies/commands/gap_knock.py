"""The command `gap knock`: the diagnosis tested on a real record with a known answer."""

import enum
from typing import Annotated

import typer

from stagectl.cli.gap_diagnose import Folder, Full, StageFile
from stagectl.cli.options import Json
from stagectl.cli.show import console, emit, progress, single_threaded_algebra
from stagectl.named_values import names_of

Into = Annotated[
    list[str] | None, typer.Option("--into", metavar="NAMES", help="Forces to add, separated by commas; default: all.")
]
Share = Annotated[
    float, typer.Option(min=0.001, max=1.0, help="Size of an added force, as a share of the recorded effort's rms.")
]


class Way(enum.StrEnum):
    """What is knocked where."""

    OUT = "out"
    IN = "in"


Only = Annotated[Way | None, typer.Option("--only", help="Only one way: out of the model, or into the record.")]


def knock(
    folder: Folder,
    stage: StageFile = None,
    into: Into = None,
    share: Share = 0.05,
    only: Only = None,
    full: Full = False,
    json: Json = None,
) -> None:
    """Remove known terms from the model, add known forces to a real record, and report what is named.

    Example: stagectl gap knock DATA_EMPS.mat --stage config/emps.yaml
    """
    single_threaded_algebra()
    from rich.table import Table

    from stagectl.config.stage_file import load_stage
    from stagectl.gap import diagnose as pipeline
    from stagectl.gap.logs import load_session as folders
    from stagectl_studies import knock_out

    session = folders.load(folder, load_stage(stage) if stage is not None else None)
    forces = names_of(into) or list(knock_out.FORCES)
    waiting = knock_out.out(session) if only is not Way.IN else []
    waiting += knock_out.into(session, forces, share) if only is not Way.OUT else []
    options, table = pipeline.Options(full=full, advice=False), Table("knocked", "way", "named", "verdict", "right")
    knocks = []
    with progress("knocked out and in", 1 + len(waiting)) as update:
        plain = pipeline.diagnose(session, options, lambda _: None).result
        for done, effect in enumerate(waiting, start=1):
            update(done, 1 + len(waiting))
            judged = knock_out.judged(effect, pipeline.diagnose(effect.session, options, lambda _: None).result, plain)
            knocks.append(judged._asdict())
            named = ", ".join(" or ".join(each) for each in judged.named)
            table.add_row(judged.name, judged.way, named, judged.verdict, "yes" if judged.right else "no")
    console.print(table)
    before = ", ".join(effect.name for effect in plain.named) or "nothing"
    console.print(f"as it is the record shows {plain.verdict}: {before}; that counts for no knock")
    right = sum(bool(knock["right"]) for knock in knocks)
    console.print(f"{right} of {len(knocks)} knocked terms are named")
    emit({"share": share, "plain": [effect.name for effect in plain.named], "knocks": knocks}, json)
