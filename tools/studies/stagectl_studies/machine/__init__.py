"""The machine that a diagnosis is examined on: a second simulator, written from the physics alone.

It imports nothing of the rest of stagectl (an import contract keeps it so), integrates by another method, knows
friction laws of its own, and draws every effect from a wider family of shapes than any candidate model: a
diagnosis cannot be right because it shares its code.  The way of one trial:

    trials.py      a seed and a stratum -> machine, nominal model, hidden effects
      effects*.py    the effects of a stage, by name, sign and scale
    battery.py     the references and injections of a session (reference.py: the segments they are made of)
    controller.py  feedforward and feedback as deployed, designed on the nominal model
    plant.py       controller, drive and mechanics in one compiled loop: explicit midpoint, 40 kHz
      contact.py, motion.py, drive.py, machine.py
    stage_trial.py writes both folders of a trial
    folder.py      what the user has: captures.yaml, nominal.yaml, CSVs
    truth.py       what the user has not: the effects, where each acts, the runs without noise
"""
