"""The names of effects, as a user types them."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from stagectl.gap.effects.effect_names import EFFECTS
from stagectl.gap.logs.session import GapError


def excluded(words: Sequence[str]) -> tuple[str, ...]:
    """Names from ``--exclude a,b --exclude c``.

    Raises GapError where one is no effect.
    """
    names = tuple(name.strip() for word in words for name in word.split(",") if name.strip())
    for name in names:
        if name not in EFFECTS:
            close = difflib.get_close_matches(name, EFFECTS, 1)
            hint = f"; did you mean {close[0]}?" if close else f"; must be one of {', '.join(EFFECTS)}"
            raise GapError(f"--exclude {name}: no such effect{hint}")
    return names
