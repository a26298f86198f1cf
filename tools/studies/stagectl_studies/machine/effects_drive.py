"""Effects of encoder, bus, drive, record and controller."""

from stagectl_studies.machine.effects import Draw, Rig, effect, factor
from stagectl_studies.machine.machine import Drive

ARC_SECOND = 4.8481368e-06  # rad


def with_drive(rig: Rig, **changes: float) -> Rig:
    """Rig with another drive."""
    drive: Drive = rig.machine.drive._replace(**changes)
    return rig._replace(machine=rig.machine._replace(drive=drive))


@effect("encoder_eccentricity", "position")
def encoder_eccentricity(rig: Rig, draw: Draw) -> Rig:
    """The encoder's disc runs 60 arc seconds out, with a second harmonic."""
    size = 60.0 * ARC_SECOND * draw.scale
    encoder = rig.machine.encoder._replace(
        eccentricity=size,
        eccentricity_phase=draw.phase(),
        eccentricity_second=size * draw.uniform(0.0, 0.3),
        eccentricity_second_phase=draw.phase(),
    )
    return rig._replace(machine=rig.machine._replace(encoder=encoder))


@effect("encoder_interpolation", "position")
def encoder_interpolation(rig: Rig, draw: Draw) -> Rig:
    """5 arc seconds within an encoder period, with a second harmonic."""
    size = 5.0 * ARC_SECOND * draw.scale
    encoder = rig.machine.encoder._replace(
        interpolation=size,
        interpolation_phase=draw.phase(),
        interpolation_second=size * draw.uniform(0.0, 0.6),
        interpolation_second_phase=draw.phase(),
    )
    return rig._replace(machine=rig.machine._replace(encoder=encoder))


@effect("current_quantisation", "current")
def current_quantisation(rig: Rig, draw: Draw) -> Rig:
    """The bus carries the command in steps of 10 mA."""
    return with_drive(rig, quantum=0.010 * draw.scale * draw.uniform(0.8, 1.25))


@effect("dead_time", "current")
def dead_time(rig: Rig, draw: Draw) -> Rig:
    """0.25 ms more until a command acts, on a grid of 25 us."""
    return with_drive(rig, delay=rig.machine.drive.delay + 0.00025 * draw.scale)


@effect("jitter", "current")
def jitter(rig: Rig, draw: Draw) -> Rig:
    """A random delay of 0.1 ms in the mean on top."""
    return with_drive(rig, jitter=0.0001 * draw.scale)


@effect("current_loop", "current")
def current_loop(rig: Rig, draw: Draw) -> Rig:
    """A slower current loop: 0.2 ms more lag, of first order or of second with overshoot."""
    lag = rig.machine.drive.lag + 0.0002 * draw.scale
    zeta = draw.uniform(0.45, 0.95)
    if draw.random.random() < 0.5:
        return with_drive(rig, lag=lag)
    return with_drive(rig, loop_damping=zeta, loop_frequency=2.0 * zeta / lag)


@effect("current_saturation", "current")
def current_saturation(rig: Rig, draw: Draw) -> Rig:
    """The drive gives 6 % less than the session's peak, and less still when it is warm."""
    limit = draw.around.peak_current / (1.0 + 0.06 * draw.scale)
    fold = limit * draw.uniform(0.88, 0.97) if draw.random.random() < 0.4 else limit
    return with_drive(rig, limit=limit, fold_limit=fold, fold_heat=draw.decades(3.0, 30.0))


@effect("voltage_saturation", "current")
def voltage_saturation(rig: Rig, draw: Draw) -> Rig:
    """The bus voltage ends 4 % before what the session's fastest move needs."""
    return with_drive(rig, voltage=draw.around.peak_voltage / (1.0 + 0.04 * draw.scale))


@effect("current_gain", "reported")
def current_gain(rig: Rig, draw: Draw) -> Rig:
    """The drive reports 1.2 % too much or too little."""
    return with_drive(rig, reported_gain=factor(draw, 0.012))


@effect("current_offset", "reported")
def current_offset(rig: Rig, draw: Draw) -> Rig:
    """25 mA that flow without a command, or that are only reported."""
    size = draw.sign * 0.025 * draw.scale
    return with_drive(rig, offset=size) if draw.random.random() < 0.5 else with_drive(rig, reported_offset=size)


@effect("time_shift", "reported")
def time_shift(rig: Rig, draw: Draw) -> Rig:
    """The reported current is half a sample early or late."""
    return with_drive(rig, reported_shift=draw.sign * 0.00025 * draw.scale)


@effect("controller", "command")
def controller(rig: Rig, draw: Draw) -> Rig:
    """Proportional gain 10 % off, and now and then the integral one too."""
    integral = factor(draw, 0.2) if draw.random.random() < 0.4 else 1.0
    loop = rig.loop
    return rig._replace(loop=loop._replace(kp=loop.kp * factor(draw, 0.1), ki=loop.ki * integral))
