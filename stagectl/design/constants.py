"""Numbers that decide what a design is compared with and what is advised.  Chosen, not derived."""

SHARES = (0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)  # of a bandwidth that is too fast, tried for the advice
FREQUENCIES = 20_000  # of the grid on which margins are found, spaced geometrically up to half the sampling rate
LOWEST = 1e-7  # lowest of them, over the sampling rate
SHORTEST_LAG = 1e-9  # s, of a current loop; a shorter one counts as none, and would make its matrix singular
