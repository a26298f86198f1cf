"""Everything from one motion with reversals: the paper's method, made convex; `method` is where it begins."""
