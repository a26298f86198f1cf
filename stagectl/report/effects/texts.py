"""The effects in words: what each is, how large on real machines, what it is mistaken for, and what tells it apart."""

from __future__ import annotations

from stagectl.report.effects.effect_text import Told as Told
from stagectl.report.effects.texts_friction import FRICTION, PARAMETERS, PLACE
from stagectl.report.effects.texts_loop import CONTROLLER, DRIVE, MECHANICS, SENSOR, TIME

GROUPS = (PARAMETERS, FRICTION, PLACE, TIME, MECHANICS, DRIVE, SENSOR, CONTROLLER)
