"""Numbers that decide something in recordings, imports and exports.  Chosen, not derived."""

# The recording file.
BLOCK = 512  # rows of a chunk, and what a crash costs at most: a quarter of a second at 2 kHz
GAPS = 32  # gaps that a file can mark; further ones are added to the last
ROOM_AT_ONCE = 1 << 14  # bytes reserved for what HDF5 keeps apart from the rows
ROOM_PER_BLOCK = 256  # bytes of the same, for each block
LONGEST_REASON = 480  # bytes of the reason of the end
LOCK_TRIES = 20  # attempts to lock a file: a process that discards one holds its lock for a moment
LOCK_PAUSE = 0.01  # s between them

# The recorder and the rings.
POLL = 0.05  # s between two looks at the ring, which holds 16 s at 2 kHz
LOOKS = 5  # periods in which two rings are compared before they are joined; rows that one may be ahead
LOOK_PAUSE = 3e-4  # s between looks: all of them are less than a period, and more than one axis needs after another
LOOK_TRIES = 200  # looks at two rings at most
REJOIN = 1.0  # s after which rings may be joined anew

# Logs of other programs.
HEADER_LINES = 100  # lines of a CSV in which its header and first numbers are looked for
EARLY = 0.5  # of a row's duration: a row belongs to the value that begins up to this much after it
EMPS_STEP = 5e-8  # m a count, of the motor's encoder seen at the load (from the EMPS benchmark)

# Exports.
RUN = 0.3  # s, run-up and run-out of an exported trajectory that begins or ends in motion
AT_REST = 1e-3  # of the largest speed: slower is at rest

# Learned currents.
NEAR = 0.01  # encoder counts by which a reference may differ: another computer's rounding
ALIKE = 1e-6  # of the largest current: by so much feedforward and friction compensation may differ
