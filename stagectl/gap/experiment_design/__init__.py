"""Which experiment to run: the battery, the catalogue, and the next one."""
