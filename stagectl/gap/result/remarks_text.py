"""What is said below the figures of a diagnosis, in lines: notes, limits, what is ambiguous, the next experiment."""

from stagectl.gap.effects.library import coordinate_label, label
from stagectl.gap.result.diagnosis import DiagnosisResult
from stagectl.gap.result.verdict_text import MOST, candidates, capital
from stagectl.number_format import percent

MOST_SPANS = 8  # logs whose open spans are listed; chosen for one screen


def ambiguous(result: DiagnosisResult) -> list[str]:
    """Effects that these data do not separate, a line each; a probability of 1 is that of all of them together."""
    lines = []
    for effect in (effect for effect in result.effects if effect.alternatives):
        probability = f"{effect.probability:.2f}"
        name = "one of them" if effect.parameter or probability == "1.00" else label(effect.name)
        lines.append(
            f"{capital(candidates(effect))}: these data fit each of them; {name} has probability {probability}."
        )
    return lines


def advice(result: DiagnosisResult) -> list[str]:
    """The next experiment in words."""
    following = result.next_experiment
    if following is None:
        return []
    names = [label(name) for name in following.separates]
    more = f" (and {', '.join(names[2:])})" if names[2:] else ""
    purpose = f"separates {' from '.join(names[:2])}{more}" if names else "shows what these logs have not shown"
    size = f" by {following.separation_sigma:.3g} sigma" if following.separation_sigma > 0.0 else ""
    line = f"Next experiment: {following.name}. It {purpose}{size}, and takes {_machine_time(following.duration)}."
    return [line, following.words] if following.words else [line]


def outside(result: DiagnosisResult) -> list[str]:
    """How to find what oscillates whatever the axis does."""
    if result.unknown is None or not result.unknown.line:
        return []
    return [
        "To find the oscillation, log the axis at standstill under power, with the machines, pumps and fans around it "
        f"on, and then off one by one. The one without which the {result.unknown.line:.3g} Hz are gone is the cause."
    ]


def _machine_time(seconds: float) -> str:
    return f"{seconds:.0f} s of machine time" if seconds < 120.0 else f"{seconds / 60.0:.0f} min of machine time"


def spans(result: DiagnosisResult) -> list[str]:
    """When the gap is open, a line a log."""
    lines = []
    for capture in result.captures:
        total = sum(end - begin for begin, end in capture.spans)
        listed = ", ".join(f"{begin:.2f} to {end:.2f} s" for begin, end in capture.spans[:MOST])
        more = f" and {len(capture.spans) - MOST} more" if len(capture.spans) > MOST else ""
        where = f"{listed}{more} ({total:.3g} s)" if capture.spans else "nowhere"
        lines.append(f"{capture.file}: {where}")
    return lines


def where(result: DiagnosisResult) -> list[str]:
    """Where the gap lies: in the loop, over the motion, and when."""
    if result.verdict == "none":
        return []
    blocks = (f"{name} {'not judged' if share is None else percent(share)}" for name, share in result.blocks.items())
    ranked = sorted(result.coordinates, key=lambda coordinate: -coordinate.share)[:MOST]
    follows = ", ".join(f"{coordinate_label(each.name)} {percent(each.share)}" for each in ranked)
    times = spans(result._replace(captures=tuple(capture for capture in result.captures if capture.spans)))
    return [
        f"where in the loop: {', '.join(blocks)}",
        *([f"what it follows: {follows}"] if ranked else []),
        *(f"open in {span}" for span in times[:MOST_SPANS]),
        *([f"and {len(times) - MOST_SPANS} more captures"] if len(times) > MOST_SPANS else []),
    ]


def lines(result: DiagnosisResult) -> list[str]:
    """All that is said below the figures: where the gap lies, notes, what is ambiguous, and the next experiment."""
    said = (where, remarks, idle, ambiguous, outside, advice)
    return [line for part in said for line in part(result)]


def idle(result: DiagnosisResult) -> list[str]:
    """Effects that explain forces, while the model with them comes no closer to the held-out runs; a line each."""
    return [
        f"{capital(label(effect.name))} explains the forces, but does not improve the model: it takes none of the gap."
        for effect in result.named
        if not effect.parameter and effect.fields and effect.share <= 0.0
    ]


def remarks(result: DiagnosisResult) -> list[str]:
    """Notes, then the limits of these logs."""
    return [*result.notes, *(f"Limit of these logs: {limit}" for limit in result.cannot_tell)]
