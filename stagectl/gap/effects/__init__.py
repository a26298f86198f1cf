"""The library of effects: where each sits, how large it is, what it is mistaken for."""
