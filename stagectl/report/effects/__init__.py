"""Each effect of the gap as the manual shows it: what it is, its picture, its lines in a stage file."""
