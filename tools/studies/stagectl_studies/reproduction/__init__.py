"""Both source papers again: every experiment on a virtual machine, every figure beside the paper's numbers."""
