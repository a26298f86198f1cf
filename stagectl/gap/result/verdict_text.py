"""A diagnosis in words: the verdict in a sentence or two, and the lines below it."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stagectl.gap.effects.library import coordinate_label, label
from stagectl.gap.result.diagnosis import (
    FLOORS,
    FORM,
    HELD_OUT,
    UNEXPLAINED,
    DiagnosisResult,
    FoundEffect,
    Gap,
    UnknownTerm,
    closable,
)
from stagectl.number_format import Travel, length, percent, portion, three_digits, together

MOST = 3  # effects in the sentence, parameters in it, and spans in a line; chosen for one line each
_MOSTLY = 0.5  # of the gap, surely closed: the model is off, whether or not a parameter stands out; chosen
_TOGETHER = 0.5  # of a force's power, within `_NARROW` of its top: most of it lies there; by definition
_NARROW = 0.04  # of the stroke, to either side: a force that lies closer together has a place; chosen
_SMALL = 0.005  # share of the gap below which its size is not stated
_LIKELY = 0.3  # probability from which an effect that is not named is mentioned
_BEYOND = 0.05  # by which a share may lie below 0 or above 1 and still be stated by itself; chosen


def sentence(result: DiagnosisResult) -> str:
    """The verdict, then the part of the friction's form, the gap before and after, and the noise floor."""
    parts = (_VERDICTS[result.verdict](result), _form(result), _distance(result))
    return " ".join(filter(None, parts))


def _form(result: DiagnosisResult) -> str:
    """What the curve of the rolling friction takes, whatever its size; where its length is named, that has it."""
    if not result.friction or any(effect.name == "presliding" for effect in result.named):
        return ""
    shares = dict(result.shares)
    share = shares.get(FORM, 0.0) / closable(shares)
    return f"{capital(portion(share))} of the closable gap is the {FORM}."


def _none(result: DiagnosisResult) -> str:
    effects = (effect for effect in result.effects if not effect.parameter)
    likely = max(effects, key=lambda effect: effect.probability, default=None)
    if likely is not None and likely.probability >= _LIKELY:
        return f"No effect is certain. {capital(candidates(likely))}: probability {likely.probability:.2f}."
    gap = result.gap
    if gap.floor > FLOORS * gap.before:
        return "Repeats of one experiment differ by more than the model does: they are not of one machine in one state."
    if gap.at_floor(gap.before):
        return "The model agrees with the machine: these logs show no missing effect and no parameter error."
    if result.friction:
        return "No effect of the library and no parameter stands out in these logs."
    if (gap.closure if np.isnan(gap.low) else gap.low) > _MOSTLY:
        return (
            "The model is off, but these logs do not show which of its parameters is: fitted together, they close "
            f"{percent(gap.closure)} of the gap."
        )
    if not gap.floor > 0.0:
        return f"No effect of the library and no parameter error stands out in these logs. {_NO_REPEAT}"
    return "No effect of the library and no parameter explains the gap of these logs."


def _controller(result: DiagnosisResult) -> str:
    verdict = "The controller that ran is not the one described, so no loop is simulated."
    beside = f"From the logged command alone: {_causes(result, result.named)}." if result.named else ""
    return " ".join(
        filter(None, [verdict, capital(result.reason), beside, "Correct its description, then diagnose again."])
    )


_NO_REPEAT = "Without a repeat they do not show whether more is missing."


def _parameters(result: DiagnosisResult) -> str:
    """The parameters that are off; that nothing else is missing only where the gap lies at a floor that is known."""
    gap, causes = result.gap, _causes(result, result.named)
    if not gap.floor > 0.0:
        return f"Parameters of the model are off: {causes}. {_NO_REPEAT.replace('they', 'these logs')}"
    rest = (
        "These logs show no missing effect, but" if gap.at_floor(gap.after) else "No effect explains what is left, and"
    )
    return f"{rest} parameters of the model are off: {causes}."


_VERDICTS: Mapping[str, Callable[[DiagnosisResult], str]] = {
    "none": _none,
    "parameters": _parameters,
    "effects": lambda r: f"{capital(_missing(r))}.{_left(r)}",
    "effects+unknown": lambda r: f"{capital(_missing(r))}. {capital(_unknown(r))}.",
    "unknown": lambda r: f"{_known_part(r)}. {capital(_unknown(r))}.",
    "controller": _controller,
    "not-identifiable": lambda r: f"These logs do not identify the cause of the gap. {r.reason}",
}


def _left(result: DiagnosisResult) -> str:
    """How much the effects leave of a gap that stays well above its floor, though nothing orders it."""
    share, gap = dict(result.shares).get(UNEXPLAINED, 0.0), result.gap
    known = gap.floor > 0.0 and result.gap.shrinks
    if not known or gap.at_floor(gap.after) or not share > _SMALL:
        return ""
    return f" {capital(portion(share))} of the gap is left unexplained."


def _known_part(result: DiagnosisResult) -> str:
    """What is known where something is not: the parameters that are off."""
    if not result.named:
        return "No effect of the library explains the gap"
    return f"Parameters of the model are off: {_causes(result, result.named)}"


def capital(text: str) -> str:
    """`text` as a sentence begins."""
    return text[:1].upper() + text[1:]


def _missing(result: DiagnosisResult) -> str:
    """The effects first: they are the news, however much more of the gap is a parameter error."""
    parameters = [effect for effect in result.named if effect.parameter]
    effects = [effect for effect in result.named if not effect.parameter] or list(result.effects[:1])
    if parameters and result.gap.shrinks and not all(_is_share(effect.share) for effect in (*effects, *parameters)):
        return _sum(result, [*effects, *parameters], _MISSING)
    causes = _causes(result, effects, _MISSING)
    if not parameters:
        return causes
    return f"{causes}; parameters of the model are off as well: {_causes(result, parameters, whole='')}"


def _is_share(share: float) -> bool:
    return -_BEYOND <= share <= 1.0 + _BEYOND


_MISSING, _OF_WHOLE = "missing in the model: ", " of the closable gap is"


def _causes(result: DiagnosisResult, effects: Sequence[FoundEffect], unsized: str = "", whole: str = _OF_WHOLE) -> str:
    """``82 % of the closable gap is viscous asymmetry (0.18), 9 % cogging``; without shares after `unsized`."""
    if not result.gap.shrinks:  # a gap that does not shrink has no shares
        causes = [_with_value(effect, result) for effect in _largest(effects)]
        return f"{unsized}{', '.join(causes)}{_more(effects)}"
    if len(effects) > 1 and not all(_is_share(effect.share) for effect in effects):
        return _sum(result, effects, unsized)
    first, *rest = _largest(effects)
    causes = [_share(first.share, whole, unsized), *(_share(effect.share) for effect in rest)]
    named = [f"{share}{_with_value(effect, result)}" for share, effect in zip(causes, (first, *rest), strict=True)]
    return ", ".join(named) + _more(effects)


def _largest(effects: Sequence[FoundEffect]) -> list[FoundEffect]:
    return sorted(effects, key=lambda effect: -effect.share)[:MOST]


def _more(effects: Sequence[FoundEffect]) -> str:
    more = len(effects) - MOST
    return f", and {more} smaller one{'s' if more > 1 else ''}" if more > 0 else ""


def _share(share: float, whole: str = "", unsized: str = "none of it ") -> str:
    """``82 % of the closable gap is``; where there is no share, as what makes the gap grow has none, `unsized`."""
    size = portion(share)
    if size == "none":
        return unsized
    return f"{size}{whole or ('' if size.endswith('%') else ' of it')} "


def _sum(result: DiagnosisResult, effects: Sequence[FoundEffect], unsized: str) -> str:
    """Effects that partly cancel: only the sum of their shares means something."""
    first, *rest = (_with_value(effect, result) for effect in effects)
    whole = _share(sum(effect.share for effect in effects), _OF_WHOLE, unsized)
    return f"{whole}{first} together with {_joined(rest, 'and')}, which partly cancel"


def _with_value(effect: FoundEffect, result: DiagnosisResult) -> str:
    """The effect, and its first parameter that is not zero where no other effect fits as well."""
    if effect.alternatives or not effect.parameters:
        return candidates(effect)
    known = effect.parameters.items()
    name, estimate = next((item for item in known if item[1].value != 0.0), next(iter(known)))
    prefix = "" if effect.parameter else f"{name.replace('_', ' ')} "
    return f"{label(effect.name)} ({prefix}{three_digits(name, estimate, result.travel)})"


def candidates(effect: FoundEffect) -> str:
    """The effect, and what these data do not separate from it: ``bias or current offset``."""
    return _joined([label(name) for name in (effect.name, *effect.alternatives)], "or")


def _joined(names: Sequence[str], last: str) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def _unknown(result: DiagnosisResult) -> str:
    """How much repeats and is unexplained, and over which coordinate."""
    share, term = dict(result.shares).get(UNEXPLAINED, 0.0), result.unknown
    repeats = "repeats and is" if result.gap.floor > 0.0 else "is"
    text = f"{f'{portion(share)} of' if share > _SMALL else 'a part of'} the gap {repeats} unexplained"
    if term is None:
        return text
    ordered = term.coordinate != "none"
    return f"{text}; {where_unknown(term, result.travel) if ordered else 'no coordinate predicts most of it'}"


def where_unknown(term: UnknownTerm, travel: Travel) -> str:
    """Where the unexplained part lies: ``it follows the speed, which predicts 92 % of it ...``."""
    predicted = percent(term.predicted)
    if term.block == "drive":
        return "the drive gives another current than its model, by more than the scatter of repeats"
    if term.coordinate == "time":
        return "friction changes from run to run in another way than any effect of the library"
    if term.line:
        return f"it oscillates at {term.line:.3g} Hz, whatever the axis does: one line holds {predicted} of it"
    if term.coordinate == "frequency":
        middle = term.grid[int(np.argmax(term.force))]
        return f"it oscillates, most near {middle:.0f} Hz: a band of one and a half octaves holds {predicted} of it"
    place = narrow_place(term) if term.coordinate == "position" else None
    at = "" if place is None else f", most of it near {length(place * travel.per_unit, travel.unit)}"
    return f"it follows the {coordinate_label(term.coordinate)}{at}, which predicts {predicted} of it on unused runs"


def narrow_place(term: UnknownTerm) -> float | None:
    """The place of the largest force, where most of its power lies close by; None where it lies anywhere."""
    power = (term.force - np.median(term.force)) ** 2
    top, reach = int(power.argmax()), max(round(_NARROW * len(power)), 1)
    near = float(power[max(top - reach, 0) : top + reach + 1].sum())
    return float(term.grid[top]) if near > _TOGETHER * float(power.sum()) else None


def _distance(result: DiagnosisResult) -> str:
    """The figures: ``Position gap 2.9 -> 0.34 µm on held-out runs, noise floor 0.21 µm.``."""
    gap = result.gap
    if result.verdict == "controller" or np.isnan(gap.before):
        return ""
    (before, after, floor), unit = together((gap.before, gap.after, gap.floor), gap.unit, result.travel)
    unchanged = result.verdict == "none" and not result.friction
    size = f"{before} {unit}" if unchanged else f"{before} -> {after} {unit}"
    if gap.effort:
        size += f" ({percent((gap.before if unchanged else gap.after) / gap.effort)} of the effort)"
    runs = "held-out run" if result.judged_on == HELD_OUT else "run"
    noise = f"noise floor {floor} {unit}" if gap.floor > 0.0 else f"noise floor not known: no {runs} was repeated"
    change = "this decrease is not significant" if gap.after < gap.before else "the model comes no closer"
    doubt = "" if result.gap.shrinks or unchanged or not result.named else f"; {change}"
    return f"{capital(headline(gap))} gap {size} on {result.judged_on}, {noise}{doubt}."


def headline(gap: Gap) -> str:
    """What the gap of the sentence is of."""
    return "effort" if gap.unit in ("N m", "N") else "position"


def closure(gap: Gap) -> str:
    """``98 % (96 to 99 %)``."""
    return f"{percent(gap.closure)} ({percent(gap.low).removesuffix(' %')} to {percent(gap.high)})"
