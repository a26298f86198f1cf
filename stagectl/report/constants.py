"""What a page draws, and how much of it.  Chosen by eye.  Sizes and places of a drawing stand beside it."""

# Curves.
ALL_ROWS = 20_000  # of a run, that its page holds; of a longer one, the lowest and the highest of each bucket
MOST_POINTS = 4000  # of a capture's curve; more is not seen
RESPONSE_POINTS, MODEL_POINTS = 1500, 300  # of a frequency response: of a tuned loop, of an identified model
BODE_RANGE = (-40.0, 60.0)  # dB, of the gain of an open loop
DENSE = 20  # frequencies above which a measured response is drawn in small dots, without a line between them

# Captures and logs.
MOST_CAPTURES = 3  # drawn of an identification
MOST_ROWS = 24  # of the map of spans: the logs whose gap is open longest
WINDOW = 1.0  # s of a held-out run, where the gap is largest
FLAT = 1e-15  # of the largest error: weight of each row, so that the window of a run without error is its middle

# Friction.
FORCE_SHOWN = 1.5  # s of force over time
MOST_REVERSALS = 40  # drawn; more hide each other
NEAR_REVERSAL = 0.13  # s either side of a zero crossing of the velocity
REVERSAL_POINTS = 400  # of the friction after a reversal
REVERSAL_BEYOND = 1.1  # times the displacement at which the slowest friction model has settled: its end

# Shares of a gap.
LEAST_SHARE = 0.01  # that is listed; less rounds to nothing next to the others
SHOWN_SHARE = 0.0005  # that has a bar of its own; less is 0.0 %

# Words in a drawing.
BLOCK_LINES, BLOCK_CHARACTERS = 4, 23  # of a block of the control loop: lines, and characters of one
LABEL_CHARACTERS = 30  # of a row's label; the middle of a longer one is left out
REASON_CHARACTERS = 30  # of a self-test's reason; a longer one is not shown
