"""Simpler ways to the same answer, on the same trials: the scale for the exam's figures.

    refit.py      the parameters that the model has, refitted, and no effect named
    ladder.py     a fixed ladder of friction models, the best by error (as BAM, arXiv 2410.08650)
    sparse.py     greedy regression on the diagnosis' own dictionary, stopped by BIC
    blackbox.py   boosted trees on the residual: how far the gap closes without any name (extra `exam`)
    oracle.py     the diagnosis' own fit, given the hidden effects: how far it can close with this library

Run as ``python -m stagectl_studies.baselines FOLDER OUT NAME...``.  Each writes what `gap diagnose` writes: answer.json
and predictions.  They share session and baseline fit (baseline_common.py).  Only the oracle knows the effects.
"""
