"""The diagnosis as data, as JSON, as words and as a patch of the stage file."""
