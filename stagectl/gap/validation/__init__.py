"""The answer checked on runs that chose nothing."""
