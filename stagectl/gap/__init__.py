"""The gap between simulator and machine: where it lies, which effect causes it, how far it shrinks."""
