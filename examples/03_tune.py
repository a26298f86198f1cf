"""Design the feedback for a phase margin, and compare it with the one that the stage file has."""

import stagectl as sc

stage = sc.load_stage("config/ball-screw.yaml")
tuned = sc.tune(stage, margin="30 deg")  # the fastest that keeps it
print(tuned)

slower = tuned.apply(stage)
for name, choice in (("as it was", stage), ("tuned", slower)):
    run = sc.simulate(choice, "config/trajectories/sine-1.6hz.yaml")
    peak = run.summary["tracking_error"]["peak"]
    print(f"{name}: {choice.loop.bandwidth:g} Hz, peak error {1e9 * peak:.1f} nm")

slower.save("recordings/tuned.yaml")
tuned.plot("sensitivities").savefig("recordings/sensitivities.png", dpi=150)
