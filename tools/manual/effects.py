"""The pages of the effects: words, pictures, and the lines of a stage file that play each of them."""

from __future__ import annotations

import difflib
import hashlib
import os
from pathlib import Path

from stagectl.config.lengths import Lengths
from stagectl.config.patch import patched
from stagectl.config.source import read_text
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.effects import effect_names
from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.result.patch import arranged
from stagectl.report.effects import texts
from stagectl.report.effects.measured_effect import Scene, motion_named
from stagectl.report.effects.scenes import scenes

PLAIN = "STAGECTL_MANUAL_PLAIN"  # set: pictures are left blank, for a quick look at text and links
BLANK = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c4890000000d49444154789c6360000002000001e5"
    "27de fc0000000049454e44ae426082".replace(" ", "")
)
FILES = ("parameters", "friction", "place", "time", "mechanics", "drive", "sensor", "controller")
SOURCES = ("stagectl/kernels", "stagectl/gap", "stagectl/report/effects", "config/ball-screw.yaml")
WITHOUT_LINES = {
    "current_quantisation": "It is `command_scale` of the drive's wire: the step of the object that takes the command.",
    "time_shift": "It belongs to the log, not to the machine: a stage file has no place for it.",
    "controller": "It is the `control` block of the stage file, to be brought in line with what runs.",
}


def pages(root: Path) -> dict[str, str]:
    """Markdown by file name: one page a group, and a table of all."""
    setup, shown = load_stage(root / "config" / "ball-screw.yaml"), scenes()
    found = {"effects/index.md": _index()}
    for file, group in zip(FILES, texts.GROUPS, strict=True):
        parts = [_effect(setup, told, shown[told.name]) for told in group.effects]
        found[f"effects/{file}.md"] = "\n\n".join([f"# {group.title}", group.words, *parts]) + "\n"
    return found


def _index() -> str:
    lines = [
        "# The effects",
        "",
        "What the diagnosis looks for, by the names that it uses. Each picture is what the diagnosis itself sees: the "
        "ball-screw stage is simulated with the effect, the model without it is tied to the path that was made, and "
        "the effort (or current) that the model then lacks is drawn over the coordinate that orders it. An effort that "
        "opposes the motion is negative where the velocity is positive: so much did the model lack. Grey is the same "
        "of a machine without the effect.",
        "",
        "The lines below each picture play the effect on the virtual drive, in a copy of `config/ball-screw.yaml`; "
        "`stagectl gap apply` writes the same ones for what it has found.",
        "",
        "| effect | name | typical size | mistaken for |",
        "|---|---|---|---|",
    ]
    for file, group in zip(FILES, texts.GROUPS, strict=True):
        for told in group.effects:
            name = effect_names.effect(told.name)
            lines.append(f"| [{name}]({file}.md#{told.name}) | `{told.name}` | {told.size} | {told.rivals} |")
    return "\n".join(lines) + "\n"


def _effect(setup: Setup, told: texts.Told, scene: Scene) -> str:
    words, motion = effect_names.effect(told.name), motion_named(setup, scene.motion)
    pictures = "\n".join(f"![{words}](pictures/{told.name}-{ground}.png#only-{ground})" for ground in ("light", "dark"))
    return "\n\n".join(
        (
            f"## {words[0].upper()}{words[1:]} {{ #{told.name} }}",
            f"`{told.name}`: {told.what}",
            pictures,
            f"*Motion: `{scene.motion}`. {motion.separates}*",
            f"* **Typical size**: {told.size}\n* **Mistaken for**: {told.rivals}\n* **Told apart by**: {told.apart}",
            _lines(setup, scene),
        )
    )


def changed(setup: Setup, scene: Scene) -> str:
    """The stage file with the effect in it."""
    base = scene.base(setup.stage)
    text, axis = read_text(setup.path), setup.file.axis
    values, _ = arranged(dict(fields_of(base, scene.change(base))), setup.file, text)
    return patched(text, values, Lengths(axis.kind, axis.lead)).text


def _lines(setup: Setup, scene: Scene) -> str:
    """The lines of the stage file that are not those of the shipped one."""
    if scene.name in WITHOUT_LINES:
        return WITHOUT_LINES[scene.name]
    text, after = read_text(setup.path), changed(setup, scene)
    kept = [line for line in difflib.ndiff(text.splitlines(), after.splitlines()) if line[0] in "+-"]
    context = _blocks(after.splitlines(), [line[2:] for line in kept if line[0] == "+"])
    return "```yaml\n" + "\n".join(context) + "\n```"


def _blocks(lines: list[str], new: list[str]) -> list[str]:
    """Each of the `new` lines below the keys of the blocks that it stands in."""
    found: list[str] = []
    path: list[str] = []
    for line in lines:
        indent = len(line) - len(line.lstrip())
        path = [one for one in path if len(one) - len(one.lstrip()) < indent]
        if line in new:
            found += [one for one in path if one not in found]
            found += [] if line in found else [line]
        if line.strip() and not line.lstrip().startswith("#"):
            path.append(line.split("#")[0].rstrip())
    return found


def pictures(root: Path) -> dict[str, Path]:
    """Pictures by the name they have in the manual; made once for the sources that they show."""
    folder = root / "build" / "manual" / _hash(root)
    names = [f"{name}-{ground}.png" for name in scenes() for ground in ("light", "dark")]
    if os.environ.get(PLAIN):
        blank = root / "build" / "manual" / "blank.png"
        blank.parent.mkdir(parents=True, exist_ok=True)
        blank.write_bytes(BLANK)
        return {f"effects/pictures/{name}": blank for name in names}
    from stagectl.report.effects.pictures import pictures as draw

    setup = load_stage(root / "config" / "ball-screw.yaml")
    for name, scene in scenes().items():
        if not (folder / f"{name}-dark.png").exists():
            draw(setup, scene, folder)
    return {f"effects/pictures/{name}": folder / name for name in names}


def _hash(root: Path) -> str:
    digest = hashlib.sha256()
    for name in SOURCES:
        place = root / name
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
