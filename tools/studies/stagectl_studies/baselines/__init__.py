"""What the exam's figures are measured against: simpler ways to the same answer, on the same trials.

    refit.py      the parameters that the model has, refitted, and no effect named
    ladder.py     a fixed ladder of friction models, the best by error (the way of BAM, arXiv 2410.08650)
    sparse.py     greedy regression on the diagnosis' own dictionary, stopped by BIC
    blackbox.py   boosted trees on what the nominal model leaves: how far the gap closes without any name (extra `exam`)
    oracle.py     the diagnosis' own fit, told which effects are there: how far it can close with this library

Run as ``python -m stagectl_studies.baselines FOLDER OUT NAME...``; each writes what `gap diagnose` writes: answer.json and
predictions.  They share session and base refit (ground.py), and none but the oracle is told anything.
"""
