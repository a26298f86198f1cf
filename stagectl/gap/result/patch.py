"""From a diagnosis to a patch of the stage file that a person can review: a diff, and the reason for each line."""

import difflib
import math
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from stagectl.config import yaml_edit
from stagectl.config.friction_laws import Rolling
from stagectl.config.hints import tag_of
from stagectl.config.lengths import Lengths
from stagectl.config.machine_file import split, text_of
from stagectl.config.patch import KEPT, Change, patched, write
from stagectl.config.source import node_at
from stagectl.config.stage_blocks import Axis, StageFile
from stagectl.config.stage_file import load_stage
from stagectl.config.unit_format import hint_at
from stagectl.gap.effects.library import coordinate_label, label
from stagectl.gap.logs.session import GapError
from stagectl.gap.result.diagnosis import FORM, DiagnosisResult, Fields, FoundEffect, Setting
from stagectl.number_format import portion

_SAME = 1e-6  # relative difference up to which two numbers are the same; that of numbers in a stage file
_ELEMENTS = {"law", "weight", "slip"}
_UNKNOWN, _FORM = "unknown", "friction_form"  # among the names that `--only` takes: the unexplained, the law's curve


class PatchError(GapError):
    """A diagnosis that cannot be written into a stage file: the `place` and the `value` that prevent it."""

    def __init__(self, message: str, place: str, value: object) -> None:
        super().__init__(message)
        self.place, self.value = place, value


class Part(NamedTuple):
    """What one effect writes."""

    name: str
    reason: str
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
        return [*(f"# {comment}" for comment in self.comments), *lines]


def patch_of(
    result: DiagnosisResult, source: Path, only: Sequence[str] = (), unknown: bool = False, text: str | None = None
) -> Patch:
    """The patch that adds the named effects to the stage file `source`; with `unknown` the data-based term as well.

    `text` is the content of `source` where that is in memory.

    Raises PatchError where there is nothing to write, ConfigError where the file has no such place.
    """
    chosen, omitted = parts(result, only, unknown)
    text = text_of(source) if text is None else text
    file = load_stage(source, designed=False, text=text).file
    check_machine(result, file.axis, source)
    if not any(place == "motor.force_constant" for part in chosen for place, _ in part.fields):
        _check_motor(result, file.motor.force_constant, source)
    patch = patch_with(merged(chosen), source, text)
    reasons = (f"{part.name}: {part.reason}" for part in chosen)
    return patch._replace(comments=(*reasons, *patch.comments, *omitted))


def patch_with(settings: Mapping[str, Setting], source: Path, text: str) -> Patch:
    """The patch that brings the stage file `source`, whose content is `text`, to these settings."""
    file = load_stage(source, designed=False, text=text).file
    values, replaced = arranged(settings, file, text)
    change = patched(text, values, Lengths(file.axis.kind, file.axis.lead))
    return Patch(source, values, text, change.text, change.changes, tuple(replaced))


def check_machine(result: DiagnosisResult, axis: Axis, source: Path) -> None:
    """Raise PatchError where the diagnosis is of another kind of axis, or of another lead."""
    hint = "give the stage file of the diagnosed machine"
    if axis.kind != result.kind:
        raise PatchError(
            f"{source}: axis.kind = {axis.kind}; the diagnosis is of a {result.kind} axis: {hint}",
            "axis.kind",
            axis.kind,
        )
    if abs(axis.travel_per_unit / result.travel_per_unit - 1.0) > _SAME:
        raise PatchError(
            f"{source}: the axis travels {axis.travel_per_unit:.6g} m a unit; that of the diagnosis travels "
            f"{result.travel_per_unit:.6g} m: {hint}",
            "axis.lead",
            axis.travel_per_unit,
        )


def _check_motor(result: DiagnosisResult, constant: float, source: Path) -> None:
    """Raise PatchError where all efforts of the diagnosis are those of another motor."""
    if result.force_constant and abs(constant / result.force_constant - 1.0) > _SAME:
        raise PatchError(
            f"{source}: motor.force_constant = {constant:.6g}; the diagnosis is of a motor with "
            f"{result.force_constant:.6g} (SI): give the diagnosed machine's stage file, or diagnose again with it",
            "motor.force_constant",
            constant,
        )


def parts(result: DiagnosisResult, only: Sequence[str] = (), unknown: bool = False) -> tuple[list[Part], list[str]]:
    """What is to be written, and a comment on each part that is not.

    Raises PatchError where nothing is, or where `only` names what the diagnosis has not found.
    """
    known = [effect.name for effect in result.effects] + ([_UNKNOWN] if result.unknown is not None else [])
    known += [_FORM] if result.friction else []
    strange = [name for name in only if name not in known]
    if strange:
        listed = ", ".join(known) or "no effect"
        raise PatchError(f"--only {strange[0]}: the diagnosis has found {listed}", "--only", strange[0])
    wanted = [effect for effect in result.effects if effect.name in only] if only else list(result.named)
    chosen = [Part(effect.name, _reason(effect), effect.fields) for effect in wanted if effect.fields]
    if result.friction and (_FORM in only or not only):
        chosen.append(Part(_FORM, f"{FORM}: the curve of its law", result.friction))
    omitted = [f"{effect.name}: not written, it has no place in a stage file" for effect in wanted if not effect.fields]
    term = result.unknown
    if term is not None and not term.fields:
        omitted.append("unknown: not written, a stage file has no term for it")
    elif term is not None and (unknown or _UNKNOWN in only):
        over = coordinate_label(term.coordinate)
        chosen.append(Part(_UNKNOWN, f"a data-based term over {over}, its cause is not known", term.fields))
    elif term is not None:
        omitted.append("unknown: not written; --unknown adds it as a data-based term")
    if not chosen:
        raise PatchError(_nothing(result, omitted), "verdict", result.verdict)
    return chosen, omitted


def with_choices(result: DiagnosisResult, names: Sequence[str]) -> DiagnosisResult:
    """The diagnosis with each of `names`, an alternative of an effect, in the place of that effect.

    Raises PatchError where a name is no alternative whose values the diagnosis has.
    """
    for name in names:
        held = next((effect for effect in result.effects if name in dict(effect.choices)), None)
        if held is None:
            known = ", ".join(other for effect in result.effects for other, _ in effect.choices) or "none"
            message = f"--choose {name}: no alternative of this diagnosis with values; there are: {known}"
            raise PatchError(message, "--choose", name)
        others = tuple(other for other in (held.name, *held.alternatives) if other != name)
        instead = held._replace(name=name, alternatives=others, fields=dict(held.choices)[name], choices=())
        result = result._replace(effects=tuple(instead if effect is held else effect for effect in result.effects))
    return result


def _nothing(result: DiagnosisResult, omitted: Sequence[str]) -> str:
    if result.verdict == "controller":
        return (
            "nothing to write: the controller that ran is not the one described; correct the stage file's `control` "
            "block"
        )
    return "; ".join([f"nothing to write: the verdict is {result.verdict!r}, and no effect is named", *omitted])


def _reason(effect: FoundEffect) -> str:
    share = f"{portion(effect.share)} of the closable gap"
    reason = f"{label(effect.name)}, {share}, probability {effect.probability:.2f}"
    if not effect.alternatives:
        return reason
    return f"{reason}; {' or '.join(map(label, effect.alternatives))} would fit these data as well"


def merged(chosen: Iterable[Part]) -> dict[str, Setting]:
    """The fields of all parts together.

    Raises PatchError where two of them want different values in one place, or a value is not finite.
    """
    settings: dict[str, Setting] = {}
    owner: dict[str, str] = {}
    for part in chosen:
        for name, value in part.fields:
            if isinstance(value, float) and not math.isfinite(value):
                raise PatchError(f"{name} = {value} from {part.name}: must be finite; omit {part.name}", name, value)
            if settings.setdefault(name, value) != value:
                raise PatchError(
                    f"{name}: {owner[name]} wants {settings[name]} and {part.name} wants {value}; "
                    f"write one of them with --only {part.name}",
                    name,
                    value,
                )
            owner.setdefault(name, part.name)
    return settings


def arranged(settings: Mapping[str, Setting], file: StageFile, text: str) -> tuple[dict[str, Any], list[str]]:
    """The settings as `config.patch` takes them, and comments: another friction law replaces its block as a whole.

    Of the old block stay the entries that the new law has as well, unless the settings hold them.
    """
    if "friction.law" not in settings:
        return dict(settings), []
    own = {name.split(".")[1]: value for name, value in settings.items() if _direct(name)}
    rest = {name: value for name, value in settings.items() if not _direct(name)}
    short = None if "friction.bristle.coulomb" in rest else _as_rolling(own, file.friction)
    if short is not None:
        return {**short, **rest}, []
    block: dict[str, Any] = {**dict.fromkeys(_kept(str(own["law"]), text), KEPT), **own}
    before = str(node_at(yaml_edit.root_of(text), "friction.law").value)
    if before == own["law"]:
        return {"friction": block, **rest}, []
    comment = f"friction: the law changes from {before} to {own['law']}, so its block is replaced as a whole"
    return {"friction": block, **rest}, [comment]


def _as_rolling(own: Mapping[str, Any], law: Any) -> dict[str, Any] | None:
    """What changes in a rolling friction, if the elements of `own` are equal and spaced as that law spaces them."""
    if not isinstance(law, Rolling) or len(own.get("weight", ())) != law.elements or set(own) != _ELEMENTS:
        return None
    rolling = law._replace(coulomb=sum(own["weight"]), shortest=own["slip"][0], longest=own["slip"][-1])
    elements = rolling.operators()
    if not (_near(elements.weight, own["weight"]) and _near(elements.slip, own["slip"])):
        return None
    changed = {name: getattr(rolling, name) for name in ("coulomb", "shortest", "longest")}
    return {f"friction.{name}": value for name, value in changed.items() if not _near([value], [getattr(law, name)])}


def _near(values: Iterable[float], others: Iterable[float]) -> bool:
    return all(abs(a - b) <= _SAME * abs(b) for a, b in zip(values, others, strict=True))


def _direct(name: str) -> bool:
    return name.startswith("friction.") and name.count(".") == 1


def _kept(law: str, text: str) -> list[str]:
    """Entries of the friction block that another `law` has, too."""
    root = yaml_edit.root_of(text)
    tag = tag_of(hint_at(StageFile, "friction", root))
    assert tag is not None  # friction is told apart by its law
    fields = getattr(tag.blocks.get(law), "_fields", ())
    return [key.value for key, _ in node_at(root, "friction").value if key.value in fields]


def backup(path: Path) -> Path:
    """A copy next to `path` under a free name: ``stage.yaml.bak``, ``stage.yaml.bak2``, ..."""
    numbers = ("", *range(2, 1000))
    free = next(target for n in numbers if not (target := path.with_name(f"{path.name}.bak{n}")).exists())
    shutil.copy2(path, free)
    return free


def applied(patch: Patch, target: Path | None = None) -> Path | None:
    """Write the patch into its file, or into a new file `target`; returns the backup of what was overwritten.

    The result has been read back: it gives the same numbers.  Raises PatchError where the file is not the one that
    was reviewed, ConfigError where `target` exists or the patched stage would be refused; nothing is changed then.
    """
    if text_of(patch.source) != patch.before:
        raise PatchError(
            f"{patch.source} has changed since the patch was shown: nothing is written, review it again",
            "source",
            patch.source,
        )
    if target is not None:
        write(patch.source, target, patch.values)
        return None
    saved = backup(split(patch.source)[0])
    try:
        write(patch.source, patch.source, patch.values)
    except BaseException:
        saved.unlink()
        raise
    return saved
