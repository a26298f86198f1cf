"""Diagnose where a machine differs from its model.  It has more viscous friction in one direction."""

import stagectl as sc

stage = sc.load_stage("config/ball-screw.yaml")
machine = stage.changed({"mechanics.viscous_asymmetry": 0.1, "simulation.current_noise": 5e-3})

# The folder: two motions, each repeated, so that noise can be distinguished from what repeats.
for number, motion in enumerate(["sine-3.2hz", "sine-1.6hz"] * 2):
    run = sc.simulate(stage, f"config/trajectories/{motion}.yaml", plant=machine, seed=number)
    run.save(f"recordings/session/{motion}-{number}.h5")

answer = sc.diagnose("recordings/session/", advice=False)
print(answer)
print("where in the loop:", answer.where.blocks)
for effect in answer.effects:
    print(effect.name, f"probability {effect.probability:.2f}", effect.parameters)

answer.plot("coordinates").savefig("recordings/coordinates.png", dpi=150)
if answer.named:
    print("\n".join(answer.patch(stage).diff))
