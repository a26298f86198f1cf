"""Move a drive over the CAN bus that the stage file names: here the embedded bus, with a virtual drive at its end."""

import stagectl as sc

stage = sc.load_stage("config/ball-screw.yaml")
motion = sc.load_trajectory("config/trajectories/sine-3.2hz.yaml", stage)

run = sc.run(stage, motion, recording="recordings/drive.h5", progress=True)
print(run)  # with notes: what was started, and what the system does not permit

model = sc.simulate(stage, motion)
count = min(len(run), len(model))
same = (run["measured"][:count] == model["measured"][:count]).mean()
print(f"{100 * same:.1f} % of the positions are those of the simulation, bit for bit")
