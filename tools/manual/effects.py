"""The pages of the effects: text, picture, and the lines of a stage file that play each of them."""

import difflib
import hashlib
import os
import re
from pathlib import Path

from stagectl_studies.effect_pictures.measured_effect import Scene, motion_named
from stagectl_studies.effect_pictures.scenes import scenes
from stagectl_studies.effect_pictures.texts import EffectText, chapters

from stagectl.config.lengths import Lengths
from stagectl.config.patch import patched
from stagectl.config.source import read_text
from stagectl.config.stage_file import Setup, load_stage
from stagectl.gap.effects.library import label
from stagectl.gap.inference.patch_fields import fields_of
from stagectl.gap.result.patch import arranged

PLAIN = "STAGECTL_MANUAL_PLAIN"  # set: pictures stay blank, for a quick look at text and links
BLANK = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c4890000000d49444154789c6360000002000001e5"
    "27de fc0000000049454e44ae426082".replace(" ", "")
)
SOURCES = (
    "stagectl/kernels",
    "stagectl/gap",
    "tools/studies/stagectl_studies/effect_pictures",
    "config/ball-screw.yaml",
)
INTRODUCTION = """# The effects

An effect is something that a machine has and its model does not contain. The table lists the effects that the
diagnosis searches for. The following pages show each of them:

* **A picture** shows what the effect leaves in the data. The ball-screw stage is simulated with the effect, and a model
  without it follows the same path. The effort (or current) that the model would need in addition is drawn over the
  coordinate on which the effect depends. An effort that opposes the motion is negative where the velocity is positive.
  Grey points show a machine without the effect.
* **Lines of a stage file** give the virtual drive this effect. Add them to a copy of `config/ball-screw.yaml`.
  `stagectl gap apply` writes the same lines for an effect that a diagnosis names.

| effect | name | typical size | mistaken for |
|---|---|---|---|
"""


def pages(root: Path) -> dict[str, str]:
    """Markdown by file name: one page a chapter, and a table of all effects."""
    setup, shown = load_stage(root / "config" / "ball-screw.yaml"), scenes()
    files = {"effects/index.md": INTRODUCTION + "".join(_rows())}
    for chapter in chapters():
        parts = [_effect(setup, text, shown[text.name]) for text in chapter.effects]
        files[f"effects/{chapter.file}.md"] = "\n\n".join([f"# {chapter.title}", chapter.text, *parts]) + "\n"
    return files


def _rows() -> list[str]:
    """Rows of the table of all effects."""
    return [
        f"| [{label(text.name)}]({chapter.file}.md#{text.name}) | `{text.name}` | {text.size} | {text.mistaken_for} |\n"
        for chapter in chapters()
        for text in chapter.effects
    ]


def _effect(setup: Setup, text: EffectText, scene: Scene) -> str:
    title, motion = label(text.name), motion_named(setup, scene.motion)
    files = "\n".join(f"![{title}](pictures/{text.name}-{theme}.png#only-{theme})" for theme in ("light", "dark"))
    facts = (("Typical size", text.size), ("Mistaken for", text.mistaken_for), ("Separated by", text.separated_by))
    return "\n\n".join(
        (
            f"## {title[0].upper()}{title[1:]} {{ #{text.name} }}",
            f"`{text.name}`: {text.what}",
            files,
            f"*The motion of the picture is `{scene.motion}`. {motion.separates}*",
            "\n".join(f"* **{name}**: {value}" for name, value in facts),
            text.lines or _lines(setup, scene),
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
    before, after = read_text(setup.path).splitlines(), changed(setup, scene).splitlines()
    new = [line[2:] for line in difflib.ndiff(before, after) if line[0] == "+"]
    shown = re.sub(r"\d+\.\d{9,}", lambda number: f"{float(number[0]):.7g}", "\n".join(_with_blocks(after, new)))
    return f"```yaml\n{shown}\n```"


def _with_blocks(lines: list[str], new: list[str]) -> list[str]:
    """Each of the `new` lines below the keys of the blocks that hold it."""
    shown: list[str] = []
    path: list[str] = []
    for line in lines:
        indent = len(line) - len(line.lstrip())
        path = [key for key in path if len(key) - len(key.lstrip()) < indent]
        if line in new:
            shown += [key for key in path if key not in shown]
            shown += [] if line in shown else [line]
        if line.strip() and not line.lstrip().startswith("#"):
            path.append(line.split("#")[0].rstrip())
    return shown


def pictures(root: Path) -> dict[str, Path]:
    """Pictures by the name they have in the manual; made once for the sources that they show."""
    folder = root / "build" / "manual" / _hash(root)
    names = [f"{name}-{theme}.png" for name in scenes() for theme in ("light", "dark")]
    if os.environ.get(PLAIN):
        blank = root / "build" / "manual" / "blank.png"
        blank.parent.mkdir(parents=True, exist_ok=True)
        blank.write_bytes(BLANK)
        return {f"effects/pictures/{name}": blank for name in names}
    from stagectl_studies.effect_pictures.pictures import pictures as draw

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
