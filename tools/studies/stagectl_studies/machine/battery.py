"""What a session runs: the recommended battery, a poor one, a short one, and what is held out."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stagectl_studies.machine.machine import Floats
from stagectl_studies.machine.reference import joined, move, multisine, rest, rows, sine, speeds, turned

MM = 2.0 * np.pi / 12.0  # rad, with 12 mm a revolution
UM = MM / 1000.0
HALF_STROKE = 60.0 * MM
REPEATS = {"diagnose": 3, "held-out": 2}


class Experiment(NamedTuple):
    """One motion: reference (n,) rad, injected current (n,) A, zero where nothing is injected."""

    name: str
    use: str
    reference: Floats
    injection: Floats


def plain(name: str, use: str, start: float, segments: Sequence[Floats]) -> Experiment:
    """An experiment without injection."""
    reference = joined(start, segments)
    return Experiment(name, use, reference, np.zeros(reference.size))


def swinging(name: str, start: float, amplitude: float, frequency: float, cycles: float) -> Experiment:
    """A sine after one reversal."""
    return plain(name, "diagnose", start, [*turned(1.0 * MM, 0.2), sine(amplitude, frequency, cycles), rest(0.2)])


def stairs(name: str, use: str, start: float, steps: Sequence[tuple[float, float]]) -> Experiment:
    """Constant speeds (mm/s, s) one way and back, and a fast move of 20 mm each way that takes what the drive has."""
    there = [(speed * MM, seconds) for speed, seconds in steps]
    back = [(-speed, seconds) for speed, seconds in there]
    dash = [move(20.0 * MM, 0.4), rest(0.3), move(-20.0 * MM, 0.4), rest(0.3)]
    return plain(
        name, use, start, [*turned(1.0 * MM, 0.2), speeds(there, 0.12), rest(0.2), speeds(back, 0.12), rest(0.2), *dash]
    )


def scan(start: float, speed: float, seconds: float) -> Experiment:
    """The stroke at one slow speed, both ways."""
    there, back = speeds([(speed, seconds)], 0.1), speeds([(-speed, seconds)], 0.1)
    return plain("scan", "diagnose", start, [*turned(1.0 * MM, 0.2), there, rest(0.2), back, rest(0.2)])


def micro(name: str, use: str, amplitude: float, frequency: float, cycles: float) -> Experiment:
    """A sine of micrometres: inside the rolling zone, about as long, or longer."""
    segments = [*turned(100.0 * UM, 0.08), rest(0.1), sine(amplitude, frequency, cycles), rest(0.1)]
    return plain(name, use, 3.0 * MM, segments)


def steps(name: str, use: str, size: float, seconds: float, dwells: Sequence[float]) -> Experiment:
    """Moves there and back, each after another dwell."""
    segments = [*turned(max(0.1 * MM, size), 0.12)]
    for number, dwell in enumerate(dwells):
        segments += [rest(dwell), move(size if number % 2 == 0 else -size, seconds)]
    return plain(name, use, -7.0 * MM, [*segments, rest(0.3)])


def excited(name: str, start: float, periods: int, random: np.random.Generator) -> Experiment:
    """A multisine current on a slow constant speed."""
    carrier = speeds([(5.0 * MM, periods + 0.3)], 0.15)
    reference = joined(start, [*turned(1.0 * MM, 0.2), carrier, rest(0.1)])
    injection = np.zeros(reference.size)
    first, n = rows(0.05 + 0.4 + 0.1 + 0.15), rows(periods + 0.3)
    injection[first : first + n] = np.round(multisine(n, 3.0, 499.0, 44, 0.8, random), 7)
    return Experiment(name, "diagnose", reference, injection)


def recommended(seed: int) -> list[Experiment]:
    """The recommended battery, about 75 s."""
    random = np.random.default_rng([seed, 1])
    slow = [(0.8, 1.0), (2.0, 0.9), (5.0, 0.8), (10.0, 0.7), (20.0, 0.6), (40.0, 0.6), (80.0, 0.45)]
    return [
        *three_sines(),
        swinging("sine-5.0", 8.0 * MM, 1.6 * MM, 5.0, 8.0),
        stairs("stairs", "diagnose", -50.0 * MM, slow),
        scan(-52.0 * MM, 16.0 * MM, 6.4),
        micro("micro-50", "diagnose", 50.0 * UM, 2.0, 4.0),
        micro("micro-8", "diagnose", 8.0 * UM, 2.0, 4.0),
        micro("micro-2", "diagnose", 2.0 * UM, 2.0, 4.0),
        steps("steps-20um", "diagnose", 20.0 * UM, 0.02, (0.3, 1.0, 3.0, 0.3)),
        steps("steps-1mm", "diagnose", 1.0 * MM, 0.12, (0.3, 1.0, 3.0, 0.3)),
        *(excited(f"multisine-{place}", x * MM, 3, random) for place, x in enumerate((-45.0, -9.0, 30.0), 1)),
    ]


def three_sines() -> list[Experiment]:
    """The poor battery: no dwell, no creep, no high frequency, no scan."""
    return [
        swinging("sine-0.8", 0.0, 10.0 * MM, 0.8, 2.0),
        swinging("sine-1.6", 0.0, 5.0 * MM, 1.6, 4.0),
        swinging("sine-3.2", 0.0, 2.0 * MM, 3.2, 6.0),
    ]


def short(seed: int) -> list[Experiment]:
    """One of each kind, about 20 s."""
    random = np.random.default_rng([seed, 1])
    quick = [(1.0, 0.4), (4.0, 0.35), (12.0, 0.3), (35.0, 0.3), (70.0, 0.25)]
    return [
        swinging("sine-1.6", 0.0, 5.0 * MM, 1.6, 2.0),
        swinging("sine-5.0", 8.0 * MM, 1.6 * MM, 5.0, 4.0),
        stairs("stairs", "diagnose", -24.0 * MM, quick),
        scan(-30.0 * MM, 25.0 * MM, 2.0),
        micro("micro-8", "diagnose", 8.0 * UM, 2.0, 2.0),
        excited("multisine-1", -9.0 * MM, 2, random),
    ]


def held_out(seed: int) -> list[Experiment]:
    """Other amplitudes, frequencies and phases, about 30 s."""
    random = np.random.default_rng([seed, 2])
    f, g, small = random.uniform(1.0, 1.4), random.uniform(2.0, 2.8), random.uniform(14.0, 30.0)
    a, b, phase = random.uniform(6.0, 8.0), random.uniform(2.0, 4.0), random.uniform(0.0, 2.0 * np.pi)
    here = float(random.uniform(-20.0, 20.0)) * MM
    both = sine(3.0 * MM, 0.7, 1.0, phase)[: rows(4.0)] + sine(0.8 * MM, 2.9, 9.6)[: rows(4.0)]
    slow = [(1.3, 0.8), (3.5, 0.7), (8.0, 0.6), (15.0, 0.5), (30.0, 0.5), (60.0, 0.4)]
    first, second = sine(a * MM, f, 2.0, phase), sine(b * MM, g, 5.0)
    return [
        plain("held-sine-a", "held-out", here, [*turned(1.0 * MM, 0.2), first, rest(0.2)]),
        plain("held-sine-b", "held-out", -here, [*turned(1.0 * MM, 0.2), second, rest(0.2)]),
        plain("held-two-tone", "held-out", here, [*turned(1.0 * MM, 0.2), both, rest(0.2)]),
        stairs("held-stairs", "held-out", -30.0 * MM, slow),
        micro("held-micro", "held-out", small * UM, float(random.uniform(1.4, 2.6)), 4.0),
        steps("held-steps", "held-out", float(random.uniform(0.2, 0.6)) * MM, 0.1, (0.2, 1.7, 0.6, 0.2)),
    ]


def held_out_short(seed: int) -> list[Experiment]:
    """Two of what is held out."""
    return [experiment for experiment in held_out(seed) if experiment.name in ("held-sine-b", "held-micro")]
