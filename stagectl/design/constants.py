"""Numbers that decide what a design is compared with and what is advised.  Chosen, not derived."""

# Of a bandwidth that is too fast, tried for the advice; kHz for Hz is no rare slip.
SHARES = tuple(digit / decade for decade in (10, 100, 1000) for digit in range(9, 0, -1))
FREQUENCIES = 20_000  # of the grid on which margins are found, spaced geometrically up to half the sampling rate
LOWEST = 1e-7  # lowest of them, over the sampling rate
SHORTEST_LAG = 1e-9  # s, of a current loop; a shorter one counts as none, and would make its matrix singular
