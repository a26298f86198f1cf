"""Columns and units of a log that does not say them, guessed from names, magnitudes and physics; `guess` begins."""
