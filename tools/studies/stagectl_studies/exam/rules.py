"""What counts: when an answer names an effect, finds it, covers it, and is beside the point.

* Only entries with a probability of at least 0.5 count as named; their order is the ranking.
* An entry that is a shift of a value that truly is off (the user's inertia, viscous or Coulomb friction), or that a
  hidden effect needs as its companion, is true and is passed over where the hidden effects are looked for.
* A cogging with its multiples is a cogging.
* Effects that all logs show alike are the same answer (on the poor battery also those that few motions show alike).
  A common change of inertia, viscous and Coulomb friction is the answer "force constant".
* Top-1: the first entry that is left *names* the effect.  Found: it stands in an entry's name or alternatives, each
  effect in an entry of its own.  Covered: it is among name and alternatives of the first entry that is left.
* The verdict ``controller`` is the entry "controller"; what a diagnosis that failed says is nothing.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from stagectl.gap.effects.effect import FAMILIES, Data
from stagectl.gap.effects.library import EFFECTS, FORCE_SCALED, look_alikes

NAMED = 0.5
COMMON = 0.03  # spread of changes that are one common change
OFF = 1e-3  # share from which a value of the model is off

EXACT: tuple[frozenset[str], ...] = tuple(
    dict.fromkeys(frozenset({name, *alike}) for name in EFFECTS if (alike := look_alikes(name, Data.ALL)))
)
WIDER = {name: frozenset(effect.generalisations) for name, effect in EFFECTS.items() if effect.generalisations}
HARMONICS = {"cogging": frozenset({"cogging_map"})}  # the cogging of the exam's machines has a second harmonic
SCALED = frozenset(FORCE_SCALED)
CLASSES = {family: tuple(e.name for e in EFFECTS.values() if e.family == family) for family in FAMILIES}
CLASS_OF = {name: kind for kind, names in CLASSES.items() for name in names}
BLOCKS = {  # by what the plant says an effect is seen in
    "torque": ("mechanics",),
    "current": ("drive",),
    "reported": ("drive", "sensor"),
    "position": ("sensor",),
    "command": ("controller",),
}
COORDINATES = {name: effect.seen_over for name, effect in EFFECTS.items() if effect.seen_over}


class Entry(NamedTuple):
    """One effect of an answer."""

    name: str
    alternatives: tuple[str, ...]
    probability: float
    parameter: bool
    change: float | None = None  # of a parameter, as a share


class Truth(NamedTuple):
    """What was hidden in a trial."""

    hidden: tuple[str, ...]  # without companions
    companions: tuple[str, ...]
    offsets: tuple[str, ...]  # values of the user's model that are off
    poor: bool
    nameable: bool = True  # False: on no list, or left out of it


def truth_of(truth: Mapping[str, Any]) -> Truth:
    """From truth.json."""
    effects = truth["effects"]
    return Truth(
        tuple(effect["name"] for effect in effects if not effect["companion"]),
        tuple(effect["name"] for effect in effects if effect["companion"]),
        tuple(name for name, ratio in truth["nominal_over_plain"].items() if abs(ratio - 1.0) > OFF),
        truth["stratum"] == "poor",
        truth["stratum"] not in ("alien", "left-out"),
    )


def entries(answer: Mapping[str, Any]) -> list[Entry]:
    """All entries of an answer, named or not."""
    if answer.get("verdict") == "controller":
        return [Entry("controller", (), 1.0, False)]
    return [
        Entry(
            effect["name"],
            tuple(effect.get("alternatives", ())),
            float(effect["probability"]),
            bool(effect.get("parameter", False)),
            (effect.get("parameters", {}).get("change") or {}).get("value"),
        )
        for effect in answer.get("effects", [])
    ]


def same(name: str, poor: bool = False) -> frozenset[str]:
    """The name and all that counts as the same answer."""
    if name not in EFFECTS:  # an effect that no library has
        return frozenset({name})
    alike = look_alikes(name, Data.ALL | Data.FEW_MOTIONS if poor else Data.ALL)
    return frozenset({name, *alike, *HARMONICS.get(name, ())})


def any_same(names: Iterable[str], poor: bool) -> frozenset[str]:
    """`same` of several names."""
    return frozenset().union(*(same(name, poor) for name in names))


def with_common_scale(named: Sequence[Entry]) -> list[Entry]:
    """The entries, a common change of inertia, viscous and Coulomb friction as the one entry that it is."""
    mine = [entry for entry in named if entry.parameter and entry.name in SCALED and entry.change is not None]
    changes = [entry.change for entry in mine if entry.change is not None]
    if {entry.name for entry in mine} != SCALED or max(changes) - min(changes) > COMMON:
        return list(named)
    first = named.index(mine[0])
    scale = Entry("force_constant", ("current_gain",), min(e.probability for e in mine), True)
    rest = [other for other in named if other not in mine]
    return [*rest[:first], scale, *rest[first:]]


def considered(truth: Truth, named: Sequence[Entry]) -> list[Entry]:
    """Named entries in which a hidden effect is looked for: what is true beside it is passed over."""
    hidden = any_same(truth.hidden, truth.poor)
    if hidden & EXACT[0] and not truth.offsets:
        named = with_common_scale(named)
    beside = {*truth.companions} - hidden
    shifts = {*truth.offsets} - hidden
    return [entry for entry in named if entry.name not in beside and not (entry.parameter and entry.name in shifts)]


def found(truth: Truth, named: Sequence[Entry]) -> list[bool]:
    """Whether each hidden effect stands in an entry, each in an entry of its own: the best such assignment."""
    wanted = [same(name, truth.poor) for name in truth.hidden]
    held = [frozenset({entry.name, *entry.alternatives}) for entry in named]

    def best(k: int, free: frozenset[int]) -> list[bool]:
        if k == len(wanted):
            return []
        tries = [[True, *best(k + 1, free - {j})] for j in sorted(free) if wanted[k] & held[j]]
        return max([*tries, [False, *best(k + 1, free)]], key=sum)

    return best(0, frozenset(range(len(held))))


def top(answer: Mapping[str, Any], named: Sequence[Entry]) -> str:
    """The first thing that an answer says, beside what is true anyway."""
    if named:
        return named[0].name
    verdict = str(answer.get("verdict", "failed"))
    return "none" if verdict in ("none", "parameters", "effects") else verdict.removeprefix("effects+")
