"""Identify a stage from a log of another program: here a CSV of time, position and current."""

from pathlib import Path

import numpy as np

import stagectl as sc

stage = sc.load_stage("config/ball-screw.yaml")

# The log: any motion with reversals will do.  Here the model is the machine.
machine = stage.changed({"mechanics.inertia": 0.0112, "mechanics.viscous": 0.17})
run = sc.simulate(machine, "config/trajectories/sine-1.6hz.yaml")
rows = np.column_stack([run["time"], run["measured"], run["measured_current"]])
Path("recordings").mkdir(exist_ok=True)
np.savetxt("recordings/log.csv", rows, delimiter=",", header="time_s,position_rad,current_A", comments="")

log = sc.load_log("recordings/log.csv", stage=stage)
print(log)

fit = sc.identify(stage, log, method="simultaneous")
print(fit)
print(f"inertia: {fit['inertia'].value:.5f} {fit['inertia'].unit}, the machine has 0.0112")

for change in fit.apply(stage).changes:
    print(change)
fit.apply(stage).save("recordings/my-stage.yaml")  # the comments of the stage file stay
