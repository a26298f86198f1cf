"""Configuration: YAML to checked NamedTuples; the type hints are the schema."""
