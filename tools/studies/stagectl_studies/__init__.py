"""Studies of stagectl: the blind exam of the diagnosis with its baselines, and both source papers reproduced."""
