"""A plant with every effect at work, for the tests that take them all at once."""

from __future__ import annotations

from stagectl.kernels import effects, jit, stage
from stagectl.kernels.effects import Harmonic, Step, Table, Warming
from stagectl.kernels.plant import Along, Base, Cable, Dwell, Reported, SpeedPower, Transmission

RIGID = Transmission()


def affected(p: stage.Stage, transmission: Transmission = RIGID) -> stage.Stage:
    """`p` with everything of the design's section 4, at realistic sizes for stage A."""
    return stage.Stage(
        drive(p.drive), motor(p.motor), mechanics(p.mechanics, transmission), friction(p.friction), encoder(p), TABLE
    )


TABLE = Table(effects.SINCE_REVERSAL, -0.01, 0.005, jit.table([-0.02, -0.01, 0.0, 0.01, 0.02]))


def drive(p: stage.Drive) -> stage.Drive:
    limits = p._replace(continuous_current=4.0, voltage_limit=48.0, resistance=1.5, back_emf=0.7)
    limits = limits._replace(gain=-0.1, gain_asymmetry=0.04, directed_offset=0.03, current_damping=0.7)
    return limits._replace(dead_time=0.7e-3, jitter=1e-5, offset=0.02, telemetry=Reported(0.01, 0.02, 2e-4))


def motor(p: stage.Motor) -> stage.Motor:
    cogs = p._replace(cogging=Harmonic(0.02, 6.0, 0.3), cogging_second=Harmonic(0.01, 12.0, 0.1))
    cogs = cogs._replace(cogging_third=Harmonic(0.003, 18.0, 0.2), cogging_fourth=Harmonic(0.002, 24.0, 0.1))
    rippled = cogs._replace(ripple=Harmonic(0.01, 24.0, 0.0), ripple_second=Harmonic(0.005, 48.0, 0.0))
    return rippled._replace(ripple_third=Harmonic(0.003, 4.0, 0.0))


def mechanics(p: stage.Mechanics, transmission: Transmission) -> stage.Mechanics:
    curved = p._replace(
        viscous_power=SpeedPower(0.04, 4.0, 0.5), viscous_asymmetry=0.05, viscous_warming=Warming(0.3, 600.0)
    )
    beside = curved._replace(
        viscous_step=Step(0.1, 0.05), cable=Cable(0.01, 0.2, 0.05, 1.0, 1.2), transmission=transmission
    )
    return beside._replace(base=Base(0.05, 20.0, 0.02), gravity=Harmonic(0.05, 1.0, 0.4))


def friction(p: stage.Friction) -> stage.Friction:
    placed = p._replace(along=Along(0.02, 0.01, 0.1), lead=Harmonic(0.05, 1.0, 0.2), ball_pass=Harmonic(0.03, 7.3, 0.4))
    placed = placed._replace(lead_second=Harmonic(0.02, 2.0, 0.1))
    timed = placed._replace(warming=Warming(0.1, 600.0), step=Step(0.1, 0.05), dwell=Dwell(0.03, 0.1))
    rising = p.stribeck._replace(rise=0.2, velocity=1.0, shape=1.5)
    return timed._replace(stribeck=rising, lag=5e-3, asymmetry=0.05, load=0.02)


def encoder(p: stage.Stage) -> stage.Encoder:
    return p.encoder._replace(
        eccentricity=Harmonic(1e-4, 1.0, 0.5),
        interpolation=Harmonic(1e-5, 1024.0, 0.0),
        interpolation_second=Harmonic(5e-6, 2048.0, 1.0),
    )
