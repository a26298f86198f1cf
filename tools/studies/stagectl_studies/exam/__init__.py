"""The blind exam: trials of the plant next door, put to the diagnosis under seal, scored when the answers are in.

    plan.py       seed and number of trials -> strata with fixed quotas, effects dealt like cards
    sitting.py    one trial from end to end; each arrow is an entry in the trial's journal
                    stage -> seal labels -> diagnose -> seal answer -> open labels -> score
                             on a poor battery:  ^---- run what it asks for, twice at most
      staging.py    trial -> captures and labels (truth, runs without noise, what the nominal model would do)
      sealing.py    salt, hash, journal; who opens early or changes a label is found
      watched.py    the diagnosis as a process of its own that may read its folder and nothing else
      rounds.py     what a diagnosis asks for is run (running.py), and it answers again
      rules.py      what counts as named, found, covered, where      closing.py  closure on withheld runs
      scoring.py    one trial's labels and answer -> one record
      asking.py     the command that answers, on its own cores (cores.py)
    exam.py       all trials, resumable, by any runner: workers.py here, stagectl.cluster elsewhere
    totals.py     records -> rows.py with Wilson intervals, limits.py, calibration, baselines (beside.py)
    ledger.py     one line an exam, bad ones too

Like the plant it imports nothing of the rest: the diagnosis is a command, its answer a JSON file.
"""
