"""Virtual drives: real nodes on a real bus, with the stage model inside and faults on demand."""
