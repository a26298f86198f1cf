"""The stage as a functional mock-up unit (FMI 3.0, co-simulation): the kernels in C behind the standard's functions."""
