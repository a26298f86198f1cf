"""The live twin: the stage model next to a running axis."""
