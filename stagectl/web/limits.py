"""Numbers that bound what a client may ask of the interface, and how long each end waits.  Chosen, unless a line says.

What clients together may take of the service stands in `service.limits`.  `assets` holds its own two: the build runs
that file alone.
"""

# Programs on the control socket (`client`, `capture_client`).
ANSWER_TIME = 60.0  # s until an answer: everything but a motion is done at once, or after a stop
MOTION_TIME = 3600.0  # s until the answer to a motion, which comes when it has ended
STOP_ANSWER = 2.0  # s until the stop path answers: 50 times what it waits for the loop itself
STOPPED = 25.0  # s until all axes stand
STOP_LOOK = 0.01  # s between two looks at axes that are being stopped
CONNECTION_TIME = 10.0  # s until the live connection of a program is open

# Requests (`http`, `routes`, `viewer`).  Longer texts are refused before they are parsed.
AXIS_NAME, CHANNEL_NAME, PATH_PART = 64, 64, 100  # characters
QUANTITY, LEVEL, FILE_NAME = 80, 40, 80  # characters: a value with its unit, a trigger's level, a recording's name
AXES, TABLES, GAINS, EFFECTS = 16, 16, 32, 64  # entries of one request
PLACE = 64  # characters of an effect's place in the model
REACHED_BACK = 3600.0  # s before now that a recording may begin with
RECORDED = 3600.0  # s that a recording takes where the request does not say

# Keys (`access_control`).
SECRET_BYTES = 32  # random bytes of a new key: 256 bits
LEAST_SECRET = 16  # characters of a key that somebody else wrote
MOST_SECRET = 256  # characters, with its line end; a longer file is another file

# The live connection (`viewer`, `routes`, `server`).
KEY_TIME = 10.0  # s for the first message, which holds the key
MESSAGE = 1 << 16  # bytes of a viewer's message
RATE = 30.0  # frames a second; the page draws what they hold with every picture of its screen
LEAST_PAUSE = 0.002  # s between two frames, however long the last one took
STATUS_PERIOD = 0.1  # s between two statuses
STATUS_AGE = 0.09  # s for which one status serves all viewers: less than their period
FAULTS_SHOWN = 20  # of the fault list, the newest
CYCLES_OVER = 1.0  # s over which cycles a second are counted
CHANNELS = 16  # that a scope shows; a request may name CHANNELS_NAMED, and is then told so
CHANNELS_NAMED = 64
LEAST_POINTS, MOST_POINTS = 10, 100_000  # of a curve
LONGEST_STRIP = 3600.0  # s
SHORTEST_SCOPE, LONGEST_SCOPE = 1e-3, 60.0  # s
LONGEST_SHARE = 0.6  # of the ring that a capture may take: the loop writes on while it is read
FREE_PAUSE = (0.05, 0.5)  # s, least and most: a scope in mode auto that sees no trigger waits for its span within these
WAITING = 1.0  # s without a trigger after which, and in which again, the viewer is told what its channel does
HELD_OFF = 0.05  # s after a capture, until the next trigger counts
LARGEST_NUMBER = 2**50  # of a request: a float64 carries it back, which is exact below 2**53

# Histogram of lateness (`status_feed`).
EDGES = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)  # s
KEPT = 60.0  # s that it covers

# Exports (`export`).
BLOCK = 1 << 18  # bytes of an export that are sent at a time
