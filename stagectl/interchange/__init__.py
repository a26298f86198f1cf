"""The stage's model in the formats of other simulators, each tried there against ours, with what it cannot hold."""
