"""Reference trajectories: where the axis shall be, at any instant, with exact velocity and acceleration.

Each trajectory is a NamedTuple of plain numbers with

* ``at(t)``, the `Motion` at any times (n,) s: relative to the axis' position at the start, 0 before t = 0, then the
  motion, then standing at ``end`` for ever;
* ``duration`` (s) and ``end`` (m);
* ``steady``, where it is not the whole run: the window (s) over which a tracking error is taken, see `steady_of`;

`check` it before use; `peaks` are what to compare with the limits of a machine.  Lengths are in the unit of
travel: m here, whatever the configuration converts them to.
"""

from stagectl.trajectories.currents import CURRENTS, CurrentMultisine, CurrentSine, CurrentSweep, Span
from stagectl.trajectories.experiments import Excited, Experiment, Phases, Released, check, phases
from stagectl.trajectories.limits import peaks
from stagectl.trajectories.motion import TrajectoryError
from stagectl.trajectories.periodic import Multisine, Sine
from stagectl.trajectories.profiles import Dwell, SCurve, Trapezoid
from stagectl.trajectories.recorded import Columns, Csv, Recorded, columns
from stagectl.trajectories.sequence import TYPES, Sequence, Sum, Trajectory
