"""Pure kernels: math on NamedTuples, compiled or interpreted with the same bits."""
