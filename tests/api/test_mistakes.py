"""Wrong arguments from Python: each is refused at the call, by its name, with what it may be."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stagectl as sc
from stagectl.api.checked import checked
from tests.conftest import CONFIG

STAGE, SINE = CONFIG / "ball-screw.yaml", CONFIG / "trajectories" / "sine-1.6hz.yaml"
TIMES = np.linspace(0.0, 1.0, 100)
sc_: Any = sc  # a type checker would refuse each of these
MISTAKES = {
    "load_stage": (lambda s: sc_.load_stage({"name": "x"}), "path = {'name': 'x'} of type dict; must be a path"),
    "text": (lambda s: sc_.load_stage(s.text), "cannot be the path of a file"),
    "pair": (lambda s: sc_.load_trajectory([TIMES, TIMES]), "a tuple (time, position)"),
    "triple": (
        lambda s: sc_.load_trajectory((TIMES, TIMES, TIMES)),
        "source of type tuple of 3 entries; must be a path or a tuple (time, position)",
    ),
    "words": (lambda s: sc_.load_trajectory((["a"], ["b"])), "source holds what is no number"),
    "stage": (lambda s: sc_.load_trajectory(SINE, STAGE), "must be what load_stage returned"),
    "without": (lambda s: sc_.simulate(s, SINE, without=None), "must be text or a list of text"),
    "keyword": (lambda s: sc_.simulate(s, SINE, wihtout=["friction"]), "did you mean without?"),
    "seed": (lambda s: sc_.simulate(s, SINE, seed="1"), "seed = '1' of type str; must be a whole number"),
    "law": (lambda s: sc_.simulate(s, SINE, friction=1.0), "friction = 1.0 of type float; must be a function"),
    "force": (lambda s: sc_.simulate(s, SINE, friction=lambda v, x, dt: None), "the friction law gives None"),
    "recording": (lambda s: sc_.run(s, SINE, recording="run.csv"), "run.csv is not the name of a recording"),
    "bandwidth": (lambda s: sc_.tune(s, [30, 40]), "must be a number in SI or text with its unit"),
    "true": (lambda s: sc_.tune(s, True), "bandwidth = True of type bool"),
    "choice": (lambda s: sc_.tune(s, law="PID"), "law = 'PID' of type str; must be one of pid, cascade"),
    "data": (lambda s: sc_.identify(s, {"time": TIMES}), "or load_log returned or a path or a list of them"),
    "letters": (lambda s: sc_.identify(s, "x.h5", compensators="table"), "must be a list of text"),
    "record": (lambda s: sc_.diagnose([s]), "session of type list; must be a path or a list of them"),
    "repeats": (lambda s: sc_.compare(s, SINE, "off", "ptc", repeats=0), "repeats 0; must lie in [1, inf)"),
    "no variants": (lambda s: sc_.compare(s, SINE), "name at least two variants, such as 'off', 'ptc'"),
    "columns": (lambda s: sc_.load_log("x.csv", {"time": 0}), "must be a dict of text or text"),
    "none": (lambda s: s.changed({"mechanics.inertia": None}), "mechanics.inertia = None; must be a single value"),
    "array": (lambda s: s.changed({"mechanics.inertia": np.ones(2)}), "must be a single value"),
    "exchanged": (lambda s: sc_.simulate(SINE, s), "(time, position): give it as `stage`"),
    "two arguments": (
        lambda s: sc_.simulate(s, SINE, friction=lambda v: 0.0),
        "friction must take (velocity",
    ),
    "units in numbers": (lambda s: sc_.load_trajectory(("5 mm", "1 Hz")), "must be numbers: (time, position) in SI"),
    "a column that is none": (lambda s: sc_.simulate(s, SINE).units["eror"], "did you mean error?"),
    "degrees": (lambda s: sc_.tune(s, margin=30), "in degrees write '30 deg'"),
    "no capture": (lambda s: sc_.identify(s, []), "no capture was given"),
    "ending": (lambda s: s.save("x.txt"), "path x.txt; must end in .yaml"),
    "complex": (lambda s: sc_.load_trajectory((TIMES, 1j * TIMES)), "source holds complex numbers; must be real"),
    "masked": (
        lambda s: sc_.load_trajectory((TIMES, np.ma.masked_array(TIMES, [*[True], *[False] * (len(TIMES) - 1)]))),
        "source holds masked values",
    ),
    "dates": (lambda s: sc_.load_trajectory((TIMES.astype("datetime64[s]"), TIMES)), "source holds dates"),
    "two columns": (lambda s: sc_.simulate(s, SINE)[["error", "current"]], "one at a time"),
    "a row": (lambda s: sc_.simulate(s, SINE)[0], "one at a time"),
    "bandwidth below 0": (lambda s: sc_.tune(s, bandwidth="-1 Hz"), "bandwidth = -1 Hz"),
    "block": (lambda s: s.changed({"mechanics": {"inertia": 0.02}}), "write {'mechanics.inertia': 0.02}"),
    "kind": (lambda s: sc_.tune(s).apply(CONFIG / "linear-slider.yaml"), "must be of the same kind"),
    "exclude": (lambda s: sc_.diagnose("x.csv", stage=s, exclude=["coging"]), "exclude coging: not an effect; did you"),
    "model": (
        lambda s: sc_.diagnose("x.csv", model={"kind": "rotary", "force_const": 0.7, "inertia": 1.0}),
        "model force_const is not known: did you mean force_constant?",
    ),
    "model's unit": (
        lambda s: sc_.diagnose("x.csv", model={"kind": "rotary", "force_constant": 0.7, "inertia": "100 kg cm^2"}),
        "must be a number in SI, without its unit: write inertia=0.01",
    ),
    "model's kind": (
        lambda s: sc_.diagnose("x.csv", model={"kind": "banana", "force_constant": 0.7, "inertia": 1.0}),
        "model kind = banana; must be one of rotary, linear",
    ),
    "two models": (
        lambda s: sc_.diagnose("x.csv", stage=s, model={"kind": "rotary", "force_constant": 0.7, "inertia": 1.0}),
        "both give the model",
    ),
    "stage first": (lambda s: sc_.diagnose(s, "x.csv"), "session of type DesignedStage; must be a path"),
    "stage second": (lambda s: sc_.diagnose("x.csv", s), "give it as `stage`"),
    "one too many": (lambda s: s.save("x.yaml", "y.yaml"), "save takes path in a row"),
    "negative seed": (lambda s: sc_.simulate(s, SINE, seed=-1), "must lie in [0, 2147483647]"),
    "millimetres": (
        lambda s: sc_.load_trajectory((TIMES, 5.0 - 5.0 * np.cos(2.0 * np.pi * TIMES)), s),
        "limits.travel",
    ),
    "step": (lambda s: sc_.load_trajectory(SINE, s).to_arrays(0), "dt 0; must lie in (0, inf) s"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_it_is_refused_by_name(name: str) -> None:
    call, words = MISTAKES[name]
    with pytest.raises(sc.StageError) as refused:
        call(sc.load_stage(STAGE))
    assert words in str(refused.value)


def test_an_entry_that_is_taken_for_an_attribute_is_shown_as_it_is_written() -> None:
    with pytest.raises(AttributeError) as refused:
        sc_.simulate(STAGE, SINE).error  # noqa: B018
    assert 'write ["error"]' in str(refused.value)


def test_columns_are_an_argument_in_python(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("a,b\n0,1\n1,2\n")
    for columns in (None, {"time": "a"}, {"zeit": "a"}, {"time": "c"}):
        with pytest.raises(sc.StageError) as refused:
            sc.load_log(log, columns)
        assert "--columns" not in str(refused.value)


def test_a_unit_that_is_not_known_is_quoted_as_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("a,b\n0,1\n1,2\n")
    with pytest.raises(sc.StageError, match=r"columns='position=b:grad': .*rad, deg, rev"):
        sc.load_log(tmp_path / "log.csv", {"time": "a", "position": "b:grad"}, STAGE)


def test_what_python_says_itself_it_says_itself() -> None:
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'trajectory'"):
        sc_.simulate(STAGE)


def test_an_unknown_attribute_says_what_there_is() -> None:
    with pytest.raises(AttributeError, match="DesignedStage has no inertia: it has changed, "):
        _ = sc.load_stage(STAGE).inertia  # type: ignore[attr-defined]
    assert not hasattr(sc, "loadStage")


def test_numbers_of_numpy_are_numbers_and_what_is_read_once_stays_unread() -> None:
    @checked
    def taken(number: float, count: int, names: Iterable[str]) -> list[str]:
        return list(names)

    called: Any = taken
    assert called(np.float32(1.0), np.int64(3), (name for name in "ab")) == ["a", "b"]
