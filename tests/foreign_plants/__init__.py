"""A machine that shares no code with stagectl: what identification is judged on, written without reading it.

::

    friction.py       six friction laws, advanced exactly or to second order in the displacement
    machine.py        one axis: drive, mechanics, encoder and a PD controller, in steps of 10 us
    motions.py        references: sine, several sines, point to point, chirp
    nominal.py        the nominal axis, read from the stage file's YAML
    capture_cases.py  a machine and a motion drawn from a seed, the log that they leave, and the truth of it
    oracle.py         the intervals of an estimator that knows the friction law

**What counts as true.**  Torque on the rotor = inertia * acceleration + viscous * velocity + friction + offset.

inertia, viscous
    of the rotor, kg m^2 and N m s/rad.  Damping of the presliding state is part of the friction, not of `viscous`.
coulomb
    Friction of steady sliding without its viscous part, at speeds far above the Stribeck speed; the mean of both
    directions.  It is not the breakaway level: the Stribeck peak at the lowest speeds lies above it.
delay
    Read the logged current as samples of a smooth curve c(t), and the logged position as samples of x(t), both at
    their common time stamps.  The torque that moves x(t) is force_constant * c(t - delay).  For a command it is the
    time until the drive applies it, half the controller's period (it holds each command for a whole one), the lag of
    the current loop, and the age of the position at its time stamp.  For a measured current it is the age of the
    position minus that of the current, where the steps of the held command are read at one phase only.  An estimator
    that reads the command as a staircase finds half a row less.
"""
