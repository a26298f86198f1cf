"""The blind exam: sealed trials of an unknown machine, diagnosed by a separate process, scored afterwards.

    plan.py           seed and number of trials -> strata with fixed quotas
    run_trial.py      one trial from end to end; each arrow is an entry in the trial's journal
                        stage -> seal labels -> diagnose -> seal answer -> open labels -> score
                                 on a poor battery:  ^---- run the proposed experiment, twice at most
      staging.py      trial -> captures and labels (truth, runs without noise, predictions of the nominal model)
      sealing.py      salt, hash, journal; opening early or changing a label is detected
      sandbox.py      the diagnosis as a process that may read its folder and nothing else
      rounds.py       the proposed experiments are run (extra_captures.py), and the diagnosis answers again
      closed.py       the stratum "closed": `gap close` on the sealed machine, run by run   closed_table.py
      rules.py        what counts as named, found, covered    realised_closure.py  closure on withheld runs
      scoring.py      labels and answer of one trial -> one record
      question.py     the command that answers, on its own cores (cores.py)
    exam.py           all trials, resumable, by any runner: workers.py here, cluster.py elsewhere
    totals.py         records -> rows.py with Wilson intervals, detection_sizes.py, calibration, baseline_table.py
    ledger.py         one line per exam, failed ones too

It imports nothing of the diagnosis: the diagnosis is a command, its answer a JSON file.  Of `gap close` it takes the
motions on which that judges itself.
"""
