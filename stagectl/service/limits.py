"""Numbers that bound what clients can take of the service, and what its processes wait for.  Chosen, not derived."""

# The stop path (`stop_path`).
TAKEN = 0.04  # s that it waits for the loop before it answers that a stop is not taken yet
LOOK = 0.0005  # s between its looks at whether a stop is taken: a period at 2 kHz
WAITING = 256  # clients that wait for that answer; each has a descriptor open
BURST = 64  # requests that it reads before it looks at the loop again
LONGEST_REQUEST = 4096  # bytes of a request
LONGEST_ANSWER = 65536  # bytes of an answer: sixteen axes
STOP_PRIORITY = 1  # SCHED_FIFO: above all that is not real-time, below every loop
PROBE = 0.5  # s between two questions of the service whether the stop path answers
PROBE_PATIENCE = 2.0  # s without an answer after which the watchdog is no longer triggered
NO_ANSWER = 0.2  # s, two periods of the page's status: an older status of the loop is not shown as the axis' state

# Connections (`web.seats`).  Each takes a descriptor.
STRANGERS, STRANGERS_EACH = 48, 16  # without a key yet: in all, and from one address; the oldest idle one makes room
READERS = 24  # with a token that reads; the oldest idle one makes room
OWNERS = 48  # with the key, or on the Unix socket; nobody else can take these
BACKLOG = 16  # connections that are accepted at once, before the limits above are looked at
HEADER_TIME = 5.0  # s for the header of a request
BODY_TIME = 10.0  # s for its body
CLOSE_TIME = 2.0  # s for a client to agree to the end of its live connection
IDLE_TIME = 15.0  # s between two requests of a connection
BODY = 1 << 16  # bytes of a body
UPLOAD = 1 << 22  # bytes of the body of a trajectory with its tables: two minutes of a record at 2 kHz
STRUCTURE = 1 << 14  # bytes of a body outside its texts: parsing keeps the event loop busy
READING_VIEWERS, MOVING_VIEWERS = 8, 4  # live connections: with the reading token; with the key
WORK_SHARE = 0.05  # of the time that one viewer may keep the event loop busy
DESCRIPTORS = 1024  # that the service asks for where it has fewer: seats, exports, processes, and as many in reserve

# Work for clients.
SETTLE = 3.0  # s after a motion in which the axis must be in position
MOTIONS_WAITING = 8  # motions that wait for their turn to be planned
PLANNED_ROWS = 2_000_000  # periods of a motion that a service takes: 1000 s at 2 kHz, 128 MB of setpoints
PLANNING_TIME = 60.0  # s after which planning is given up and its process killed
PLANNING_MEMORY = 2 << 30  # bytes of address space of the process that plans
EXPORTS_WAITING = 4  # exports that wait for their turn, or are being fetched
EXPORT_TIME = 120.0  # s that an export may take, and processor time of its process
EXPORT_MEMORY = 4 << 30  # bytes of address space of the process that exports
EXPORT_FILE = 8 << 30  # bytes of an exported file
FETCH_TIME = 600.0  # s in which a client must have fetched what was exported

# Who is killed where memory runs out (oom_score_adj): what works for clients first, the loop last.
DISPENSABLE, SERVICE, LOOP = 1000, -500, -900  # the unit allows the last one: `OOMScoreAdjust=`

# Black boxes (`black_box`).
BOXES_KEPT = 4  # faults whose rows are kept in memory while the disk is full, 5 MB each at 2 kHz
BOX_RETRY = 5.0  # s between two attempts to write them

# Jog (`jog`): a key that is held.
HELD = 0.3  # s without a sign that it is, after which the axis brakes: three signs of a page, one of which may be late
JOG_LOOK = 0.01  # s between two looks at that
DEAD_MAN = 0.5  # s of a jog that the loop has at most after such a sign: then it brakes, whatever the service does
FURTHEST = 10.0  # s of motion that one press gives at most
PRESSES = 256  # presses that have ended and are remembered, so that a late message begins none of them again

# Processes (`processes`, and `web.server` as the service begins).
AT_ONCE = 0.2  # s after a child's end in which a signal to all processes counts as its cause
