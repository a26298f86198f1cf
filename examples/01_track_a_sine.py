"""Track a sine on the model of the stage, and draw what it achieves."""

import stagectl as sc

stage = sc.load_stage("config/ball-screw.yaml")
motion = sc.load_trajectory("config/trajectories/sine-1.6hz.yaml", stage)
print(stage)  # gains and margins

run = sc.simulate(stage, motion)
bare = sc.simulate(stage, motion, without=["friction"])
print(run)

for name, record in (("with", run), ("without", bare)):
    peak = abs(record.tracking_error()).max()
    print(f"{name} friction compensation: peak error {1e6 * peak:.3f} um over the whole run")

run.save("recordings/sine.h5")  # the same file as `stagectl simulate` writes
run.plot().savefig("recordings/sine.png", dpi=150)
