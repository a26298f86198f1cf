"""stagectl: real-time control of a precision stage, its simulator, and the gap between the two.

**The tour: the way of one setpoint.**  Open the files in this order; each says what it does in its first lines.

::

    config/ball-screw.yaml  config/trajectories/sine-1.6hz.yaml
              |                         |
    [1] config/stage_file.py    [2] config/trajectory_file.py       YAML, with units, strictly read
              |                         |  trajectories/            position, velocity, acceleration
    [3] design/                         |                           gains, margins, refusal
              |                         |
    [4] plan.py <-----------------------+                           limits checked, one row a period
              |
        cli/motion.py -> workflows/motion.py -> service/single_motion.py                starts loop and recorder, hands over the rows
              |
    [5] realtime/loop.py   one period, 2000 times a second:
              |
              |   drives/canopen/drive.py  sample()  -- SYNC -->  drive      the position at t_k is latched,
              |                                <- TPDO --              the last command begins to act
              |   kernels/law.py     step()    feedforward (PTC)  kernels/feedforward.py
              |                                + feedback         kernels/feedback.py (PID), cascade.py (P-PI)
              |                                - disturbance      kernels/observer.py
              |                                + friction         kernels/friction.py, compensation/
              |                                + learned current  learning.py          -> limit -> current
              |   realtime/safety.py   judge()   may it go on?
              |   drives/canopen/drive.py  apply()   -- RPDO -->  drive      acts from t_k+1 on: nd = 1
              |   recording/ring.py  write()   ==> recorder process ==> recording.h5
              v
    [6] drives/virtual/node.py   the drive, where there is no machine: a CANopen node with kernels/stage.py inside
              |          drives/odrive.py, odrive_virtual.py: the same over a serial line, as text
              |          drives/faults.py   what can fail: one table for YAML, `inject`, `selftest` and the manual;
              |          node_deeds.py does it, faulty_bus.py to frames; selftest/ tries all in virtual time
              |          drives/canopen/presets.py   families of drives, from their documents; probe.py: `drive probe`

              command -> drive -> motor -> mechanics <- friction,  encoder -> measured

    recording.h5 -> recording/hdf5.py -> exports.py, replay.py, evaluation.py

    [7] kernels/rollout.py   law and stage in one compiled loop: `simulate`; the same rows, to the last bit
    [8] evaluation.py, report/run.py   what it achieved, in words, figures and one page: `report`

**The way of one capture**, from a record of any motion back into the stage file::

    recording.h5, a CSV with units, a .mat, a folder of captures
              |
    [9] identification/captures.py   columns in axis units, split at gaps; suspicion.py: does it look sound?
              |
    [10] identification/methods.py   the method by its name: simultaneous/, response/, constant_speed, low_speed,
              |                      reversal/, friction/, least_squares; each has an `identify`
              v
    [11] identification/result.py     parameters with 95 % intervals, reversal table, what cannot be told apart
              |
              +--> cli/identification.py  table and JSON      report/  a page with the method's figures
              +--> config/patch.py   `--write`: the stage file's values change, its comments stay

**The way of one diagnosis**, from logs of a machine to what the model lacks::

    recordings, a folder of captures, a log
              |
    [12] gap/logs/load_session.py     a Session: logs on their periods, nominal model, deployed law
    [13] gap/controller_check/command_check.py   the command recomputed with the deployed law
         gap/residuals/model_tracking.py         residual effort and missing current; whitening.py: by the noise of repeats
    [14] gap/selection/baseline_fit.py           the model's own parameters refitted; residuals/friction_family.py
    [15] gap/library*.py   every effect: its place in kernels/plant.py, its sizes    gap/residuals/sensitivities.py  what each does
    [16] gap/residuals/gram_matrices.py      all data as small matrices; linear_fit.py: fits on them
         gap/selection/null_ensemble.py      machines without any effect; detection_thresholds.py: what exceeds them
    [17] gap/selection/search.py     which effects: candidate_scores.py, acceptance.py, refine.py, swap_tests.py
    [18] gap/inference/verdict.py    names, rivals, intervals; shifts.py   where.py, coordinates.py, unknown.py   where it lies
    [19] gap/validation/held_out_gap.py     held-out runs, before and after       gap/experiment_design/experiment_proposal.py  the experiment that separates
              v
         gap/result/diagnosis.py      the answer: report/gap/page.py draws it, gap/result/patch.py writes it into the stage file
                           report/effects/ pictures each effect for the manual; config/manual_reference.py its YAML pages

    exam/             the machine that the diagnosis is examined on, which shares nothing with the rest; `gap exam`
    exam/blind/       draws its trials, seals the labels, watches the diagnosis, scores it; baselines/ beside it
    gap/knock_out.py     the same on a real record: terms knocked out of the model, forces knocked into the record
    twin/live_model.py       the model beside the axis while it runs: `run --twin`, `gap watch`, `gap drift`
    tuning/           gains for a bandwidth and a margin, from the identified model, into the stage file
    paired_comparison.py     layers against each other, repeats interleaved; workflows/trials.py runs them, and the learning
    reproduction/     both papers from end to end, ours beside theirs

**The way of one order**, of a service that runs for months::

    stagectl move ... --> web/client.py --> HTTP, Unix socket --> web/http.py, orders.py  systemd/  installed
                                                                        |
    [20] service/axis_controller.py    one axis as the service sees it: plans, gains  service/service.py  processes, fault list
    [21] realtime/shared_memory.py     shared memory: orders and setpoints in, status out
    [22] realtime/axes.py      the real-time process, several axes     realtime/axis.py, entries.py, sources.py  one of them
         config/machine_file.py  several axes in one file: xy.yaml, and xy.yaml#x for one of them
    [23] realtime/states.py    what each event leads to     stops.py  what each fault leads to     safety.py  what is one
    [24] service/black_box.py  ten seconds before each fault and two after it     recordings.py  what is wanted
    [25] daemon/page/        the live page: viewer.py reads the ring, live.py packs it, static/ is it; door.py who may
         recording/extremes.py, triggering.py   no peak lost; what a scope waits for; `stagectl scope` is the terminal's
         service/foxglove_live.py  every row for Foxglove

**Signs.**  Positive current gives positive effort and moves towards positive positions.  The error is reference
minus measured.  Friction is what opposes the velocity: positive at positive velocity::

              effort = Kt i  -->  [ J, D ]  -->  + x, + v
              friction       <--

**Units.**  SI inside, names bare: a rotary axis is in rad and N m, a linear one in m and N, and no kernel knows
which.  A ball screw is a rotary axis with a lead.  Units appear in YAML values, in column names of exports, and on
the screen; `units.Quantity` beside each field declares unit, range and meaning once for all of them.

**Where things are decided.**  What runs, and how strictly: YAML.  Whether it may run: `design` (margin) and `plan`
(limits).  Whether it may go on: `realtime/safety.py`.  Imports run one way only, from `cli` down to `units`; the
contract stands in pyproject.toml and ``tools/check`` enforces it.
"""
