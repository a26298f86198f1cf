"""A diagnosis in words: one sentence that can be understood at night, and the lines below it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stagectl.gap.effects import library
from stagectl.gap.result.diagnosis import UNEXPLAINED, DiagnosisResult, FoundEffect, Gap, UnknownTerm
from stagectl.gap.result.gap_numbers import percent, together, value
from stagectl.gap.result.result_json import as_json as as_json  # the same answer for a machine

_PLACES = {  # a quantity that a gap is measured in, as a sentence calls it
    "position": "position gap",
    "tracking_error": "tracking gap",
    "tracking": "tracking gap",
    "effort": "effort gap",
    "torque": "torque gap",
    "force": "force gap",
    "current": "current gap",
}
_NOT_CLOSED = ("none", "not-identifiable")  # verdicts under which nothing was put into the model
_BLIND = "These logs cannot tell what causes the gap."
MOST = 3  # effects in the sentence, and values that are off
_OF_ALL = " of the closable gap is"
_SMALL = 0.005  # share that is not worth a word
_LIKELY = 0.3  # probability from which an effect without a name is worth a word
_ODD = 0.05  # by which a share may lie below nothing or above all, and still be told


def sentence(found: DiagnosisResult) -> str:
    """The verdict, then what it stands on: gap before and after, and the noise floor."""
    return f"{_VERDICTS[found.verdict](found)} {_distance(found)}".strip()


def _none(found: DiagnosisResult) -> str:
    likely = max((one for one in found.effects if not one.parameter), key=lambda one: one.probability, default=None)
    if likely is not None and likely.probability >= _LIKELY:
        return f"Nothing is surely missing; {either(likely)} may be, with probability {likely.probability:.2f}."
    return "The model agrees with the machine: no effect is missing and no value is off by more than these logs show."


def _parameters(found: DiagnosisResult) -> str:
    of = _OF_ALL if _shrinks(found) else ""
    return f"No effect is missing, but values of the model are off: {_shares(found, found.named, of)}."


def _effects(found: DiagnosisResult) -> str:
    return f"{_capital(_missing(found))}."


def _partly(found: DiagnosisResult) -> str:
    return f"{_capital(_missing(found))}; {_unknown(found)}."


def _unexplained(found: DiagnosisResult) -> str:
    return f"The model lacks something that no effect of the library explains: {_unknown(found)}."


def _controller(found: DiagnosisResult) -> str:
    told = "The controller that ran is not the one described, so nothing behind it is judged."
    return " ".join(filter(None, [told, found.reason, "Mend its description first, then diagnose again."]))


def _unidentifiable(found: DiagnosisResult) -> str:
    rivals = [either(one) for one in found.effects if one.alternatives]
    told = f"These logs cannot tell what causes the gap: {rivals[0]}." if rivals else _BLIND
    following = found.next_experiment
    advised = f"The experiment {following.name!r} would tell." if following is not None else ""
    return " ".join(filter(None, [told, found.reason, advised]))


_VERDICTS: Mapping[str, Callable[[DiagnosisResult], str]] = {
    "none": _none,
    "parameters": _parameters,
    "effects": _effects,
    "effects+unknown": _partly,
    "unknown": _unexplained,
    "controller": _controller,
    "not-identifiable": _unidentifiable,
}


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _missing(found: DiagnosisResult) -> str:
    """The effects; they are the news, however much more is a value that is off."""
    values = [one for one in found.named if one.parameter]
    effects = [one for one in found.named if not one.parameter] or list(found.effects[:1])
    if values and _shrinks(found) and not all(-_ODD <= one.share <= 1.0 + _ODD for one in (*effects, *values)):
        return _together(found, [*effects, *values])
    told = _shares(found, effects)
    return f"{told}; values of the model are off, too: {_shares(found, values, '')}" if values else told


def _shares(found: DiagnosisResult, those: Sequence[FoundEffect], of: str = _OF_ALL) -> str:
    """``82 % of the closable gap is viscous asymmetry (0.18), 9 % cogging``."""
    first, *rest = sorted(those, key=lambda one: -one.share)[:MOST]
    if _shrinks(found):
        told = [f"{percent(first.share)}{of} {_with_value(first, found)}"]
        told += [f"{percent(one.share)} {_with_value(one, found)}" for one in rest]
    else:  # shares of a gap that stays are no shares
        told = [f"{'the model lacks ' if of else ''}{_with_value(first, found)}"]
        told += [_with_value(one, found) for one in rest]
    more = len(those) - MOST
    return ", ".join(told) + (f", and {more} smaller one{'s' if more > 1 else ''}" if more > 0 else "")


def _together(found: DiagnosisResult, those: Sequence[FoundEffect]) -> str:
    """What partly undoes each other: shares of 355 % and -170 % tell nobody anything, their sum does."""
    first, *rest = (_with_value(one, found) for one in those)
    whole = percent(sum(one.share for one in those))
    return f"{whole}{_OF_ALL} {first} together with {_joined(rest, 'and')}, which partly undo each other"


def _with_value(one: FoundEffect, found: DiagnosisResult) -> str:
    """What it is, and its first parameter where there is no doubt which effect it is."""
    if one.alternatives or not one.parameters:
        return either(one)
    name, parameter = next(iter(one.parameters.items()))
    label = "" if one.parameter else f"{name.replace('_', ' ')} "
    return f"{library.label(one.name)} ({label}{value(name, parameter, found)})"


def either(one: FoundEffect) -> str:
    """The effect, and what these data cannot tell it from: ``bias or current offset``."""
    return _joined([library.label(name) for name in (one.name, *one.alternatives)], "or")


def _joined(names: Sequence[str], last: str) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def _unknown(found: DiagnosisResult) -> str:
    """What repeats and has no name, and over which coordinate."""
    share = dict(found.shares).get(UNEXPLAINED, 0.0)
    size = f"{percent(share)} of the gap repeats" if share > _SMALL else "a part of the gap repeats"
    if found.unknown is None:
        return f"{size} and has no name"
    if found.unknown.coordinate == "none":
        return f"{size} and has no name; no coordinate that was tried predicts most of it"
    return f"{size} and has no name; {where_unknown(found.unknown)}"


def where_unknown(one: UnknownTerm) -> str:
    """Where what has no name is found: ``it follows the speed, which predicts 92 % of it ...``."""
    told = percent(one.predicted)
    if one.block == "drive":
        return "the drive gives another current than its model, more than the scatter of repeats"
    if one.coordinate == "time":
        return "friction changes from run to run in another way than any effect of the library"
    if one.coordinate == "frequency":
        middle = one.grid[int(np.argmax(one.force))]
        return f"it rings, strongest near {middle:.0f} Hz: a band of one and a half octaves holds {told} of it"
    where = library.coordinate_label(one.coordinate)
    return f"it follows the {where}, which predicts {told} of it on runs that were not used"


def _distance(found: DiagnosisResult) -> str:
    """The figures: ``Tracking gap 2.9 -> 0.34 µm on held-out runs, floor 0.21 µm``."""
    if found.verdict == "controller":
        return ""
    what, gap = headline(found)
    (before, after, floor), unit = together((gap.before, gap.after, gap.floor), gap.unit, found)
    size = f"{before} {unit}" if found.verdict in _NOT_CLOSED else f"{before} -> {after} {unit}"
    known = f"floor {floor} {unit}" if gap.floor > 0.0 else "floor not known: no run was repeated"
    put_in = found.named and found.verdict not in _NOT_CLOSED
    doubt = "" if _shrinks(found) or not put_in else ": not surely smaller, so only the forces speak for it"
    return f"{_capital(what)} {size} on held-out runs, {known}{doubt}."


def _shrinks(found: DiagnosisResult) -> bool:
    """Whether the held-out runs say that the gap is smaller with what is named; at its floor they cannot."""
    _, gap = headline(found)
    return not gap.low <= 0.0  # unknown counts as before


def headline(found: DiagnosisResult) -> tuple[str, Gap]:
    """The gap that a sentence names: that of the tracking error where it is known."""
    for name in ("tracking_error", "tracking"):
        if name in found.gaps:
            return called(name), found.gaps[name]
    return ("effort gap" if found.gap.unit in ("N m", "N") else "position gap"), found.gap


def called(name: str) -> str:
    """``tracking gap`` for the key ``tracking_error`` of the gaps."""
    return _PLACES.get(name, f"{name.replace('_', ' ')} gap")


def closure(gap: Gap) -> str:
    """``closed 98 % (96 to 99 %)``."""
    return f"{percent(gap.closure)} ({percent(gap.low).removesuffix(' %')} to {percent(gap.high)})"


def ambiguous(found: DiagnosisResult) -> list[str]:
    """What these data cannot tell apart, a line an effect."""
    return [
        f"{_capital(either(one))}: these data fit all of them alike; "
        f"{library.label(one.name)} has probability {one.probability:.2f}."
        for one in found.effects
        if one.alternatives
    ]


def advice(found: DiagnosisResult) -> list[str]:
    """The next experiment in words."""
    one = found.next_experiment
    if one is None:
        return []
    apart = " from ".join(library.label(name) for name in one.separates[:2])
    rest = [library.label(name) for name in one.separates[2:]]
    told = f"tells {apart}" + (f" (and {', '.join(rest)})" if rest else "") if apart else "shows what no run has shown"
    how_far = f" by {one.separation_sigma:.3g} sigma" if one.separation_sigma > 0.0 else ""
    lines = [f"Next experiment: {one.name}. It {told}{how_far} in {_machine(one.duration)}."]
    return [*lines, one.words] if one.words else lines


def _machine(seconds: float) -> str:
    return f"{seconds:.0f} s of machine time" if seconds < 120.0 else f"{seconds / 60.0:.0f} min of machine time"


def spans(found: DiagnosisResult) -> list[str]:
    """When the gap is open, a line a log."""
    shown = []
    for one in found.captures:
        open_for = sum(end - begin for begin, end in one.spans)
        where = ", ".join(f"{begin:.2f} to {end:.2f} s" for begin, end in one.spans[:MOST])
        more = f" and {len(one.spans) - MOST} more" if len(one.spans) > MOST else ""
        shown.append(f"{one.file}: {where}{more} ({open_for:.2g} s)" if one.spans else f"{one.file}: nowhere")
    return shown


def quietly(found: DiagnosisResult) -> Sequence[str]:
    """Notes, then what cannot be told."""
    return [*found.notes, *(f"cannot be told: {one}" for one in found.cannot_tell)]
