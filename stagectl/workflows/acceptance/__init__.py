"""The first power of a drive, in steps that a person lets happen: what must be tried before the first real motion."""
