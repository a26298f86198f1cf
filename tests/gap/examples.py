"""Diagnoses as they may come out, one for each verdict; figures of stage A, rotary with a lead of 12 mm."""

from __future__ import annotations

import math

import numpy as np

from stagectl.gap.result.diagnosis import (
    Coordinate,
    DiagnosisResult,
    FoundEffect,
    Gap,
    NextExperiment,
    Spans,
    Trace,
    UnknownTerm,
    Value,
)
from stagectl.gap.result.verdict_text import sentence

PER_UNIT = 0.012 / (2.0 * math.pi)  # m per rad
MICRON = 1e-6 / PER_UNIT  # rad
_RANDOM = np.random.default_rng(4)


ASYMMETRY = FoundEffect(
    "viscous_asymmetry",
    (),
    0.97,
    0.82,
    {"share": Value(0.1823, 0.1741, 0.1905, "")},
    fields=(("mechanics.bias", 0.031),),
    coordinate="speed",
)
COGGING = FoundEffect(
    "cogging",
    ("encoder_eccentricity",),
    0.61,
    0.09,
    {
        "amplitude": Value(0.0204, 0.0188, 0.0220, "N m"),
        "order": Value(4.0, 4.0, 4.0, ""),
        "phase": Value(1.2, 1.05, 1.35, "rad"),
    },
    block="drive",
    fields=(("drive.current_lag", 2.5e-4),),
    coordinate="position_mod_pitch",
)
VISCOUS = FoundEffect(
    "viscous",
    (),
    0.99,
    0.91,
    {"viscous": Value(0.1681, 0.1665, 0.1697, "N m s/rad")},
    fields=(("mechanics.viscous", 0.1681),),
    parameter=True,
    coordinate="speed",
)
PRESLIDING = FoundEffect(
    "presliding",
    (),
    0.93,
    0.55,
    {"length": Value(14.0 * MICRON, 13.1 * MICRON, 14.9 * MICRON, "rad")},
    fields=(
        ("friction.law", "stop-operators"),
        ("friction.weight", (0.3, 0.25, 0.46)),
        ("friction.slip", (0.25 * MICRON, 1.5 * MICRON, 14.0 * MICRON)),
        ("friction.stribeck.rise", 0.12),
        ("friction.stribeck.velocity", 4.0),
    ),
    coordinate="displacement_since_reversal",
)
WEAK = ASYMMETRY._replace(name="stribeck", probability=0.21, share=0.02, fields=())


def gap(before: float, after: float, floor: float = 0.21) -> Gap:
    """Of the position, all in µm."""
    closure = 1.0 - (after**2 - floor**2) / max(before**2 - floor**2, 1e-12)
    return Gap(before * MICRON, after * MICRON, floor * MICRON, "rad", closure, closure - 0.02, closure + 0.01, 0.97)


def trace(name: str, size: float, left: float) -> Trace:
    """Two seconds of a sine; gaps in µm."""
    t = np.arange(0.0, 2.0, 5e-4)
    wave = np.sin(2.0 * np.pi * 1.6 * t)
    shape = np.abs(np.cos(2.0 * np.pi * 1.6 * t)) + 0.2 * np.sign(wave)
    noise = 0.15 * _RANDOM.standard_normal((2, len(t)))
    before, after = MICRON * (size * shape + noise[0]), MICRON * (left * shape + noise[1])
    return Trace(name, t, 10.0 * wave, before, after, 0.21 * MICRON)


CAPTURES = (
    Spans("sine-1.6hz-1.csv", ((0.1, 0.35), (0.6, 0.95), (1.2, 1.5)), 2.0),
    Spans("stairs-both-ways-1.csv", ((1.0, 6.0), (9.0, 12.5)), 14.0),
    Spans("micro-sine-8um-1.csv", (), 6.0),
    Spans("multisine-carrier-middle-1.csv", ((2.0, 3.0),), 8.0),
)
COORDINATES = (
    Coordinate("speed", 0.81),
    Coordinate("direction", 0.44),
    Coordinate("displacement_since_reversal", 0.06),
)
BLOCKS: dict[str, float | None] = {"controller": 0.0, "drive": 0.03, "mechanics": 0.95, "sensor": 0.02}
NEXT = NextExperiment(
    "stairs both ways, 8 speeds",
    "next/stairs-both-ways.yaml",
    ("cogging", "encoder_eccentricity"),
    11.3,
    14.0,
    "Eight speeds from 2 to 80 mm/s, forwards and backwards.",
    "type: sine\n",
)
SHAPE = UnknownTerm("position", np.linspace(-25.0, 25.0, 60), 0.05 * np.sin(np.linspace(0.0, 9.0, 60)), 0.71)


def found(verdict: str, **changes: object) -> DiagnosisResult:
    """Two effects unless `changes` say otherwise, with its sentence."""
    plain = DiagnosisResult(
        verdict,
        "",
        (ASYMMETRY, COGGING, WEAK),
        gap(2.9, 0.34),
        {
            "current": Gap(0.062, 0.0071, 0.004, "A", 0.99, 0.98, 0.995),
            "effort": Gap(0.045, 0.0051, 0.003, "N m", 0.99, 0.98, 0.995),
        },
        BLOCKS,
        COORDINATES,
        CAPTURES,
        (
            ("parameters", 0.02),
            ("viscous_asymmetry", 0.82),
            ("cogging", 0.09),
            ("repeatable but unexplained", 0.055),
            ("not repeatable", 0.015),
        ),
        traces=(trace("held-sine-2.4hz-1.csv", 3.0, 0.2), trace("held-stairs-1.csv", 2.0, 0.1)),
        next_experiment=NEXT,
        notes=("multisine-carrier-end-2.csv: 14 rows at the current limit are left out.",),
        cannot_tell=("A lead error: the encoder sits at the motor.",),
        kind="rotary",
        travel_per_unit=PER_UNIT,
        travel_unit="m",
        seconds=(("base refit", 2.1), ("search", 7.4)),
    )
    changed = plain._replace(**changes)  # type: ignore[arg-type]
    return changed._replace(sentence=sentence(changed))


def every() -> dict[str, DiagnosisResult]:
    """One of each verdict, and one of a log without a controller."""
    nothing = {"next_experiment": None, "unknown": None}
    return {
        "none": found("none", effects=(WEAK,), gap=gap(0.23, 0.22), gaps={},
                      shares=(("parameters", 0.0), ("not repeatable", 1.0)), traces=(trace("held.csv", 0.05, 0.04),),
                      captures=tuple(capture._replace(spans=()) for capture in CAPTURES), coordinates=(), **nothing),
        "parameters": found("parameters", effects=(VISCOUS,), next_experiment=None,
                            shares=(("parameters", 0.94), ("repeatable but unexplained", 0.04),
                                    ("not repeatable", 0.02))),
        "effects": found("effects"),
        "effects+unknown": found("effects+unknown", effects=(PRESLIDING,), unknown=SHAPE,
                                 shares=(("parameters", 0.05), ("presliding", 0.55),
                                         ("repeatable but unexplained", 0.37), ("not repeatable", 0.03))),
        "unknown": found("unknown", effects=(WEAK,), unknown=SHAPE, gap=gap(2.9, 0.9), gaps={},
                         shares=(("parameters", 0.03), ("repeatable but unexplained", 0.95),
                                 ("not repeatable", 0.02))),
        "controller": found("controller", effects=(), gap=gap(40.0, 40.0), gaps={}, coordinates=(), shares=(),
                            traces=(), blocks={"controller": 1.0, "drive": None, "mechanics": None, "sensor": None},
                            captures=(), reason="The integral gain looks like 0.5 of the nominal one.", **nothing),
        "not-identifiable": found("not-identifiable", effects=(), gap=gap(math.nan, math.nan), gaps={}, captures=(),
                                  shares=(), traces=(), coordinates=(), reason="Only one speed was run.", **nothing,
                                  cannot_tell=("Only one speed was run.",)),
        "foreign": found("effects", effects=(ASYMMETRY,), traces=(),
                         gap=Gap(12.0, 3.1, math.nan, "N", 0.93, 0.90, 0.95, None, 31.0), gaps={},
                         blocks={"controller": None, "drive": None, "mechanics": 1.0, "sensor": None}, kind="linear",
                         travel_per_unit=1.0, captures=(), next_experiment=None,
                         cannot_tell=("Controller and drive: no current was logged and no controller is known.",)),
    }  # fmt: skip
