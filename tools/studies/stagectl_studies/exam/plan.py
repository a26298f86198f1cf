"""Which trials an exam holds: strata with fixed quotas, effects dealt evenly, in an order that tells nothing."""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import stagectl
import stagectl_studies
from stagectl_studies.exam.rules import EXACT, WIDER
from stagectl_studies.machine.effects import ALIENS, EFFECTS
from stagectl_studies.machine.stages import LAWS, Ground
from stagectl_studies.machine.trials import STRATA as _DRAWN  # noqa: F401  its import enters the effects into their tables

QUOTAS = {  # of 300 trials; at least 30 in each group: null, single, pair, triple, left-out, alien, poor
    "null-exact": 12,
    "null-parameters": 12,
    "null-law": 12,
    "single-0.5": 24,
    "single-1": 24,
    "single-2": 24,
    "single-4": 24,
    "pair": 36,
    "triple": 33,
    "left-out": 33,
    "alien": 33,
    "poor": 33,
}
CLOSED = "closed"  # what `gap close` makes of the machine; minutes a trial, so only where it is asked for
ON_REQUEST = {CLOSED: 30}
SIZES = {"pair": 2, "triple": 3}
_STOPPING = frozenset({"controller"})  # with another controller than the one described, nothing else is judged
_FITTED = frozenset({"inertia", "viscous", "coulomb", "bias", "time_shift", "presliding"})  # by the base refit anyway
_NEVER_LEFT_OUT = frozenset(
    {*_FITTED, "friction_lag", *(name for pair in EXACT for name in pair)}
)  # another holds them


class ExamError(Exception):
    """An exam that cannot be held as asked."""


class Planned(NamedTuple):
    """One trial; `number` is all that its folder tells."""

    number: int
    stratum: str
    seed: int
    effects: tuple[str, ...] = ()
    scale: float | None = None  # None: drawn
    exclude: tuple[str, ...] = ()  # for `--exclude`
    ground: Ground | None = None  # of a record; None: drawn
    law: str | None = None  # of friction; None: drawn

    @property
    def drawn_as(self) -> str:
        """The stratum's name where trials are drawn."""
        if self.stratum == CLOSED:
            return "triple"
        return "single" if self.stratum.startswith(("single", "left-out")) else self.stratum


def packages() -> tuple[Path, Path]:
    """Folders of what is examined and of what examines it."""
    return Path(stagectl.__file__).parent, Path(stagectl_studies.__file__).parent


def sources(*roots: Path) -> str:
    """Hash of all sources below `roots`: the version that a trial examined."""
    digest = hashlib.sha256()
    for root in roots:
        for path in sorted(root.rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def source_seed(*roots: Path) -> int:
    """Seed from the hash of all sources below `roots`: nobody can tune to the exam of his own version."""
    return int(sources(*roots)[:8], 16) >> 1


def quotas(trials: int, strata: Sequence[str] = ()) -> dict[str, int]:
    """Trials of each stratum, in proportion to `QUOTAS`; what rounding leaves goes to the largest remainders.

    Raises ExamError where a stratum is none of them.
    """
    chosen = {name: (QUOTAS | ON_REQUEST)[name] for name in expanded(strata)}
    whole = sum(chosen.values())
    exact = {name: trials * weight / whole for name, weight in chosen.items()}
    counts = {name: int(share) for name, share in exact.items()}
    largest = sorted(exact, key=lambda name: counts[name] - exact[name])
    for name in largest[: trials - sum(counts.values())]:
        counts[name] += 1
    return counts


def expanded(strata: Sequence[str]) -> list[str]:
    """Names of strata; ``null`` and ``single`` stand for all of theirs, none for all but those on request.

    Raises ExamError where a name is none.
    """
    groups = []
    for asked in strata or QUOTAS:
        known = (*QUOTAS, *ON_REQUEST)
        mine = [name for name in known if name == asked or (asked in ("null", "single") and name.startswith(asked))]
        if not mine:
            raise ExamError(f"--strata {asked}: no such stratum; must be one of null, single, {', '.join(known)}")
        groups += [name for name in mine if name not in groups]
    return groups


def deck(names: Sequence[str], random: np.random.Generator) -> Iterator[str]:
    """The names over and over, shuffled anew each time: every one comes up as often as the others, or once less."""
    while True:
        yield from (str(name) for name in random.permutation(sorted(names)))


def together(effects: Iterator[str], count: int) -> tuple[str, ...]:
    """The next effects of the deck that can be told apart from each other."""
    names: list[str] = []
    while len(names) < count:
        name = next(effects)
        related = {other for pair in EXACT if name in pair for other in pair} | {name} | WIDER.get(name, frozenset())
        held = {other for word in names for other in WIDER.get(word, frozenset())}
        if name not in _STOPPING and not related & set(names) and name not in held:
            names.append(name)
    return tuple(names)


def plan(trials: int, seed: int, strata: Sequence[str] = ()) -> list[Planned]:
    """All trials of an exam: the same seed, number and strata give the same plan."""
    random = np.random.default_rng([seed, 11])
    cards = {
        "all": deck(list(EFFECTS), random),
        "several": deck(sorted(set(EFFECTS) - _STOPPING), random),
        "left-out": deck(sorted(set(EFFECTS) - _STOPPING - _NEVER_LEFT_OUT), random),
        "alien": deck(list(ALIENS), random),
        "sizes": deck(["1", "2", "3"], random),
        "laws": deck(LAWS[1:], random),  # none that stagectl's friction model holds element by element
    }
    asked = [name for name, count in quotas(trials, strata).items() for _ in range(count)]
    made = [_trial(stratum, cards, random) for stratum in asked]
    order = random.permutation(len(made))
    seeds = np.random.SeedSequence([seed, 12]).generate_state(max(len(made), 1), np.uint32) >> 1
    return [Planned(number + 1, seed=int(seeds[number]), **made[place]) for number, place in enumerate(order.tolist())]


def _trial(stratum: str, cards: dict[str, Iterator[str]], random: np.random.Generator) -> dict[str, Any]:
    kind, _, scale = stratum.partition("-")
    if kind == "single":
        return {"stratum": stratum, "effects": (next(cards["all"]),), "scale": float(scale)}
    if stratum in SIZES:
        return {"stratum": stratum, "effects": together(cards["several"], SIZES[stratum])}
    if stratum == CLOSED:
        effects = together(cards["several"], int(next(cards["sizes"])))
        return {"stratum": stratum, "effects": effects, "law": next(cards["laws"])}
    if stratum == "left-out":
        name = next(cards["left-out"])
        exclude = (name, *sorted(WIDER.get(name, frozenset())))
        return {"stratum": stratum, "effects": (name,), "scale": float(random.choice([2.0, 4.0])), "exclude": exclude}
    if stratum == "alien":
        return {"stratum": stratum, "effects": (next(cards["alien"]),), "scale": float(random.choice([1.0, 2.0]))}
    return {"stratum": stratum, "effects": (next(cards["several"]),)} if stratum == "poor" else {"stratum": stratum}
