"""Commands about the computer: doctor, service install, service remove."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stagectl.cli.options import Json, StageArgument, Stages, option
from stagectl.cli.show import console, emit, without_compiler

if TYPE_CHECKING:
    from stagectl.service.install import Step

Root = Annotated[Path, option("--root FOLDER", "Root folder of the target system.")]
service = typer.Typer(help="The systemd service: install, remove.", no_args_is_help=True)


def doctor(
    stage: StageArgument,
    state: Annotated[
        Path | None, option("--state FOLDER", "State folder of the service; default: $STATE_DIRECTORY.")
    ] = None,
    json: Json = None,
) -> None:
    """Check whether this computer can run the stage, with the command that fixes each problem.

    Example: stagectl doctor config/ball-screw.yaml
    """
    without_compiler()
    from stagectl.config.stage_file import load_stage
    from stagectl.runtime_folder import state_folder
    from stagectl.service.doctor import examine
    from stagectl.web.client import default_socket

    checks = list(examine(load_stage(stage), state or state_folder(), default_socket().exists()))
    for check in checks:
        console.print(
            f"{'ok ' if check.good else 'BAD'}  {check.name}: {check.words}", style="green" if check.good else "red"
        )
        if not check.good:
            console.print(f"       {check.fix}")
    fit = all(check.good for check in checks)
    rows = [{"name": check.name, "good": check.good, "words": check.words, "mend": check.fix} for check in checks]
    emit({"checks": rows, "fit": fit}, json, fit)


@service.command("install")
def install(
    stages: Stages,
    root: Root = Path("/"),
    tcp: Annotated[str, option("--tcp HOST:PORT", "Also serve over TCP; a token allows reading.")] = "",
    no_start: Annotated[bool, option("--no-start", "Enable the unit without starting it.")] = False,
    json: Json = None,
) -> None:
    """Install user, unit, network and udev files, and start the service.

    Example: sudo stagectl service install /etc/stagectl/stage.yaml
    """
    from stagectl.cli.addresses import unit_port
    from stagectl.config.stage_file import load_stage
    from stagectl.service import install as systemd
    from stagectl.service.machine import named, together

    read = tuple((name, path.absolute(), load_stage(path)) for name, path in named(stages).items())
    installation = systemd.Installation(read, systemd.interpreter(), unit_port(tcp), together(stages))
    _tell(systemd.install(installation, root, not no_start), json)


@service.command("remove")
def remove(root: Root = Path("/"), json: Json = None) -> None:
    """Stop the service and remove what install wrote; recordings, black boxes and their user stay.

    Example: sudo stagectl service remove
    """
    from stagectl.service.install import remove as take_away

    _tell(take_away(root), json)


def _tell(done: list[Step], json: str | None) -> None:
    for step in done:
        console.print(step.words)
    good = all(step.good for step in done)
    if not good:
        console.print("not all of it was done: see the lines above")
    emit({"done": [step.words for step in done], "failed": [step.words for step in done if not step.good]}, json, good)
