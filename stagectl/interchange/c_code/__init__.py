"""The kernels as C: a translator of the subset of Python in which they are written, which refuses everything else."""
