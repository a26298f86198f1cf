"""From a diagnosis to a patch of the stage file that a person can review: a diff, and why each line changes."""

from __future__ import annotations

import difflib
import math
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config import yaml_edit
from stagectl.config.loader import Lengths
from stagectl.config.patch import KEPT, Change, patched, write
from stagectl.config.source import node_at, read_text
from stagectl.config.stage_file import Axis, Rolling, StageFile, load_stage
from stagectl.config.unit_format import hint_at, tag_of
from stagectl.gap.effects import library
from stagectl.gap.logs.session import GapError
from stagectl.gap.result.diagnosis import DiagnosisResult, Fields, FoundEffect, Setting
from stagectl.gap.result.gap_numbers import percent

_SAME = 1e-6  # relative difference that is none
_ELEMENTS = {"law", "weight", "slip"}
_UNKNOWN = "unknown"  # its name among those that `--only` takes


class Part(NamedTuple):
    """What one effect writes."""

    name: str
    why: str
    fields: Fields


class Patch(NamedTuple):
    """A change of a stage file that is not made yet."""

    source: Path
    values: dict[str, Any]  # SI by dotted name, as `config.patch` takes them
    before: str
    after: str
    changes: tuple[Change, ...]
    comments: tuple[str, ...]  # of the diff

    @property
    def diff(self) -> list[str]:
        """Lines of a unified diff, with the comments in front."""
        old, new = self.before.splitlines(), self.after.splitlines()
        name = str(self.source)
        lines = difflib.unified_diff(old, new, name, f"{name} (patched)", lineterm="")
        return [*(f"# {one}" for one in self.comments), *lines]


def patch_of(found: DiagnosisResult, source: Path, only: Sequence[str] = (), unknown: bool = False) -> Patch:
    """The patch that adds the named effects to the stage file `source`; with `unknown` the data-based term as well.

    Raises GapError where there is nothing to write, ConfigError where the file has no such place.
    """
    chosen, left = parts(found, only, unknown)
    settings = merged(chosen)
    file = load_stage(source, judged=False).file
    axis = file.axis
    check_machine(found, axis, source)
    text = read_text(source)
    values, replaced = arranged(settings, file, text)
    made = patched(text, values, Lengths(axis.kind, axis.lead))
    comments = (*(f"{one.name}: {one.why}" for one in chosen), *replaced, *left)
    return Patch(source, values, text, made.text, made.changes, comments)


def check_machine(found: DiagnosisResult, axis: Axis, source: Path) -> None:
    """Raise GapError where the diagnosis is of another kind of axis, or of another lead."""
    if axis.kind != found.kind or abs(axis.travel_per_unit / found.travel_per_unit - 1.0) > _SAME:
        raise GapError(
            f"{source} is a {axis.kind} axis of {axis.travel_per_unit:.6g} m a unit; the diagnosis is of a "
            f"{found.kind} axis of {found.travel_per_unit:.6g} m: give the stage file of the machine that was diagnosed"
        )


def parts(found: DiagnosisResult, only: Sequence[str] = (), unknown: bool = False) -> tuple[list[Part], list[str]]:
    """What is to be written, and in words what is not.

    Raises GapError where nothing is, or where `only` names what the diagnosis has not found.
    """
    known = [one.name for one in found.effects] + ([_UNKNOWN] if found.unknown is not None else [])
    strange = [name for name in only if name not in known]
    if strange:
        listed = ", ".join(known) or "no effect"
        raise GapError(f"--only {strange[0]}: this diagnosis has not found it; it has {listed}")
    wanted = [one for one in found.effects if one.name in only] if only else list(found.named)
    chosen = [Part(one.name, _why(one), one.fields) for one in wanted if one.fields]
    left = [f"{one.name}: not written, it has no place in a stage file" for one in wanted if not one.fields]
    if found.unknown is not None:
        if (unknown or _UNKNOWN in only) and found.unknown.fields:
            where = library.coordinate_label(found.unknown.coordinate)
            chosen.append(Part(_UNKNOWN, f"a data-based term over {where}, not a cause", found.unknown.fields))
        elif found.unknown.fields:
            left.append("unknown: not written; --unknown adds it as a data-based term")
        else:
            left.append("unknown: not written, no coordinate of a stage file holds it")
    if not chosen:
        raise GapError(_nothing(found, left))
    return chosen, left


def _nothing(found: DiagnosisResult, left: Sequence[str]) -> str:
    if found.verdict == "controller":
        return (
            "nothing to write: the controller that ran is not the one described; mend the stage file's `control` block"
        )
    return "; ".join([f"nothing to write: the verdict is {found.verdict!r}, and no effect is named", *left])


def _why(one: FoundEffect) -> str:
    told = f"{library.label(one.name)}, {percent(one.share)} of the closable gap, probability {one.probability:.2f}"
    if not one.alternatives:
        return told
    names = " or ".join(library.label(name) for name in one.alternatives)
    return f"{told}; {names} would fit these data as well"


def merged(chosen: Iterable[Part]) -> dict[str, Setting]:
    """The fields of all parts together.

    Raises GapError where two of them want different values in one place, or a value is not finite.
    """
    settings: dict[str, Setting] = {}
    owner: dict[str, str] = {}
    for part in chosen:
        for name, value in part.fields:
            if isinstance(value, float) and not math.isfinite(value):
                raise GapError(f"{name} = {value} from {part.name}: no number for a stage file; leave {part.name} out")
            if settings.setdefault(name, value) != value:
                raise GapError(
                    f"{name}: {owner[name]} wants {settings[name]} and {part.name} wants {value}; "
                    f"write one of them with --only {part.name}"
                )
            owner.setdefault(name, part.name)
    return settings


def arranged(settings: Mapping[str, Setting], file: StageFile, text: str) -> tuple[dict[str, Any], list[str]]:
    """As `config.patch` takes them, and what is to be said: a friction that follows another law is a block as a whole.

    Of the old block stay the entries that the new law has as well and that nothing new is said of.
    """
    if "friction.law" not in settings:
        return dict(settings), []
    own = {name.split(".")[1]: value for name, value in settings.items() if _direct(name)}
    rest = {name: value for name, value in settings.items() if not _direct(name)}
    short = _as_rolling(own, file.friction)
    if short is not None:
        return {**short, **rest}, []
    block: dict[str, Any] = {**dict.fromkeys(_kept(str(own["law"]), text), KEPT), **own}
    before = _law(text)
    if before == own["law"]:
        return {"friction": block, **rest}, []
    told = f"friction: the law changes from {before} to {own['law']}, so its block is replaced as a whole"
    return {"friction": block, **rest}, [told]


def _as_rolling(own: Mapping[str, Any], law: Any) -> dict[str, Any] | None:
    """What changes in a rolling friction, if the elements of `own` are equal and spaced as that law spaces them."""
    if not isinstance(law, Rolling) or len(own.get("weight", ())) != law.elements or set(own) != _ELEMENTS:
        return None
    asked = law._replace(coulomb=sum(own["weight"]), shortest=own["slip"][0], longest=own["slip"][-1])
    given = asked.operators()
    if not (_near(given.weight, own["weight"]) and _near(given.slip, own["slip"])):
        return None
    changed = {name: getattr(asked, name) for name in ("coulomb", "shortest", "longest")}
    return {f"friction.{name}": value for name, value in changed.items() if not _near([value], [getattr(law, name)])}


def _near(found: Iterable[float], wanted: Iterable[float]) -> bool:
    return all(abs(a - b) <= _SAME * abs(b) for a, b in zip(found, wanted, strict=True))


def _direct(name: str) -> bool:
    return name.startswith("friction.") and name.count(".") == 1


def _law(text: str) -> str:
    node = node_at(yaml_edit.root_of(text), "friction.law")
    return str(node.value)


def _kept(law: str, text: str) -> list[str]:
    """Entries of the friction block that another `law` has, too."""
    root = yaml_edit.root_of(text)
    tag = tag_of(hint_at(StageFile, "friction", root))
    assert tag is not None  # friction is told apart by its law
    fields = getattr(tag.blocks.get(law), "_fields", ())
    return [key.value for key, _ in node_at(root, "friction").value if key.value in fields]


def backup(path: Path) -> Path:
    """A copy beside `path` under a name that is not taken: ``stage.yaml.bak``, ``stage.yaml.bak2``, ..."""
    numbers = ("", *range(2, 1000))
    free = next(target for n in numbers if not (target := path.with_name(f"{path.name}.bak{n}")).exists())
    shutil.copy2(path, free)
    return free


def applied(patch: Patch, target: Path | None = None) -> Path | None:
    """Write the patch into its file, or into a new file `target`; the backup of what was overwritten.

    The result has been read back: it gives the same numbers.  Raises GapError where `target` exists or the file is not
    the one that was reviewed, ConfigError where the patched stage would be refused; nothing is changed then.
    """
    if read_text(patch.source) != patch.before:
        raise GapError(f"{patch.source} has changed since the patch was shown: nothing is written, look at it again")
    if target is not None:
        if target.exists():
            raise GapError(f"{target} exists: choose another name, or patch it itself by naming it as the stage file")
        write(patch.source, target, patch.values)
        return None
    saved = backup(patch.source)
    try:
        write(patch.source, patch.source, patch.values)
    except BaseException:
        saved.unlink()
        raise
    return saved
