"""How much of the zoo is tried: a sample, as in CI, or with ``STAGECTL_ZOO=all`` (``make zoo``) everything."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from typing import TypeVar

T = TypeVar("T")
WHOLE = os.environ.get("STAGECTL_ZOO") == "all"


def sample(every: Iterable[T], few: Collection[T]) -> list[T]:
    """Every case, or those of `few`; `few` must be among them."""
    cases = list(every)
    assert set(few) <= set(cases), set(few) - set(cases)
    return [case for case in cases if WHOLE or case in few]
