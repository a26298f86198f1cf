"""Compensation on a machine of another hand: identified from one ordinary motion, compensated, tracked.

The axis is the exam's machine, which shares no code with stagectl: another integrator, its own friction laws.  The way
of one trial::

    friction_laws.py   a law and a seed -> machine
    axis.py            a plan of stagectl, carried out by that machine
    trial.py           one motion identified, all compensators tracked, learning on top
    __main__.py        ``python -m stagectl_studies.foreign``: the table
"""
