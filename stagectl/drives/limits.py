"""Every number that decides something in the drives' room: times, counts and factors, with unit, origin and effect.

Object indices, bit masks, abort codes and widths of formats are not here: they belong to the standards (`cia402`).
"chosen" means: set by judgement, not derived.
"""

# The controller's side of a CANopen drive (canopen/drive.py, power_states.py)
ENABLE_TIME = 5.0  # s; chosen; Operation enabled must be reached within it, and a brake's release besides
FOUND_POWER_TIME = 1.0  # s; chosen; for the ramp of a drive found under power, and again for the end of its power
BACKLOG = 64  # frames; chosen; most that are cleared before a SYNC, so that a babbling node cannot block the loop
REPEAT_COMMAND_CYCLES = 8  # cycles; chosen; a drive still in operation after them gets its stop command again, by SDO
RESET_HOLD = 0.3  # s; chosen; bit 7 stays so long at most: drives were met that want 50 ms of it, and that poll slowly
RESET_PAUSE = 0.1  # s; chosen; between two edges of bit 7
RESET_EDGES = 3  # edges; chosen; a fault that survives them has a cause that is still there
RESET_TIME = RESET_EDGES * (RESET_HOLD + RESET_PAUSE)  # s; all of them
TORQUE_TIME = 0.01  # s; chosen; from Operation enabled to the release of a brake: the current must be there
BRAKE_REPEAT_CYCLES = 20  # cycles; chosen; an order to a brake, by SDO, that is not confirmed by then is given again
BRAKE_PATIENCE = 1.0  # s; chosen; beyond its time, for a brake whose setting is not confirmed; then power goes
CERTAIN_FAULT_CYCLES = 3  # cycles; chosen; state Fault lasts so long before power is given up
STANDSTILL_CYCLES = 100  # cycles; chosen; without motion for so long, the axis stands still
STANDING = 1e-4  # s; chosen; times the ramp's deceleration: speed below which an axis counts as standing

YOUNG_HEARTBEAT = 1.0  # s; chosen; a drive heard so lately, after its last answer, is there; decides words alone

OLD_ANSWERS = 3  # answers; SYNC n shows n - 1, and some drives n - 2: so many may precede an order, and one is spare

# A drive under power (canopen/operation_watch.py)
LEARNING_TIME = 0.5  # s; chosen; from Operation enabled on: a drive shows statusword bits 9 and 12 in it, or never
STATUS_BIT_TIME = 0.005  # s; chosen; a demanded bit may be missing so long, and for CERTAIN_CYCLES
MODE_PERIOD = 0.1  # s; chosen; between two questions for 0x6061, by SDO: 0.1 % of a bus of 1 Mbit/s
WRONG_MODES = 2  # answers; chosen; that show another mode, one after the other

# Homing by the drive (homing.py, canopen/drive_homing.py)
SLOW_SHARE = 0.2  # of homing.speed; chosen; speed at the switch where the stage file names none
SEARCH_TIME = 0.1  # s; chosen; in which a search reaches its speed: its current must not look like an end stop
HOMING_GRACE = 5.0  # s; chosen; beyond the time of the way: changes of mode, ramps, the drive's own pauses
STALE_TIME = 0.05  # s; chosen; after the start, statusword bits 12 and 13 may be those of the homing before

# Whether the drive gives what it is told (realtime/envelope.py, realtime/safety.py)
CURRENT_SHARE = 0.1  # of the command; chosen; by which the measured current may differ: scale of a good drive
CURRENT_FLOOR = 0.05  # of drive.current_limit; chosen; offset and resolution of the drive's measurement
CURRENT_NOISE = 6.0  # times the rms noise of the stage file: one period in a thousand million
CURRENT_LAGS = 4.0  # time constants of the current loop in which it follows: 98 %
CURRENT_TIME = 0.02  # s; chosen; so long in sum, periods that agree taken off, the current may be another
FROZEN_TIME = 0.01  # s; chosen; position and current repeat to the last bit while the command changes
FROZEN_QUANTA = 4.0  # counts of the measured current; chosen; a smaller change of the command need not show

# Whether the drive's own ramp brakes (canopen/braking_monitor.py)
SPEED_WINDOW = 9  # samples; chosen; the median of their steps survives a jump and a corrupted frame
FASTER_FACTOR, FASTER_SLACK = 1.5, 5e-3  # 1 and s of the ramp; chosen; above factor x speed + slack x ramp: faster
LONGER_FACTOR, SETTLING_TIME = 1.5, 0.06  # 1 and s; chosen; after factor x ramp time + settling half the speed is gone,
CREEP = 5e-4  # s of the ramp; chosen; or no more than this is left, which is what noise looks like
CERTAIN_CYCLES = 3  # cycles; chosen; an observation must last so long: one corrupted frame proves nothing
SILENT_CYCLES = 2  # cycles; chosen; answers missing in a row after which the bus counts as lost

# Configuration over SDO (canopen/configuration.py)
BOOT_UP_TIME = 2.0  # s; chosen; after a reset the boot-up message is waited for; then SDO is tried: some send none
STATE_TIME = 0.05  # s; chosen; for the answer to a request for the NMT state
SETUPS = 3  # attempts; chosen; a drive that boots in mid set-up is set up again; then it is refused
# A booting drive swallows the first request, which is soon repeated.  Once it answers, an object that it keeps in flash
# may take most of a second (canopen #25, CanOpenSTM32 #89); nothing has power yet, and nothing waits for it.
BOOT_ANSWER_TIME, SDO_ANSWER_TIME = 0.3, 1.0  # s; see above; longest wait for one answer
SDO_TRIES = 3  # requests; chosen; a late answer is not taken for another one (`PumpedSdo`)
MODE_TIME = 1.0  # s; chosen; 0x6061 is waited for so long; some drives show the mode only once they are enabled
MODE_REPEAT = 0.3  # s; chosen; an ordered mode that is not shown is ordered again: three questions fit in between
ROUNDED = 0.01  # of a value; chosen; a drive may round the ramp that is written so much
INCREMENTS = 1e-6  # of a resolution; rounding of 0x608F, whose two numbers are whole

# Protection (canopen/protection.py) and the time-outs that the stage file does not state (config/time_outs.py)
BEATS = 4  # signs of life in a time-out; chosen; one may be lost and one late; the life time factor of node guarding
FREE_SHARE = 0.1  # of the travel; chosen; that an axis may go beyond either end, where limits.free_distance is absent
TIMEOUT_PERIODS = 8  # control periods; chosen; the shortest time-out: two lost frames and a late one are no loss
SHORTEST_TIMEOUT = 0.008  # s; chosen; what a computer with PREEMPT_RT and a bus with other traffic hold
LONGEST_TIMEOUT = 0.1  # s; chosen; no axis needs more, however much room it has
ANSWER_PERIODS = 4  # control periods; chosen; the longest wait for an answer: then the loop stops the axis

# Reading a drive without configuring it (canopen/probe.py, dump.py)
PROBE_ANSWER_TIME = 0.5  # s; chosen; longest wait for one answer
SILENT_OBJECTS = 3  # objects; chosen; in a row without an answer: nobody is there
SCAN_AT_ONCE, SCAN_TIME = 8, 0.02  # requests, s; chosen; a scan asks so many ids at once and waits so long for answers
SHOWN_NAME = 200  # characters; chosen; longest device name that is shown

# Buses
MTIME_SETTLED = 100_000_000  # ns; ten ticks of a slow file system clock; a newer mtime may hide a second change
SLCAN_READ_TIME = 0.0002  # s; chosen; python-can's own time-out, which a look at an empty queue would wait for
SLCAN_OPENING_TIME = 0.1  # s; chosen; an adapter's time to open its channel
PORT_QUEUE = 256  # frames; chosen; that wait for a port of a shared bus which nobody reads
# A fault that the axis must survive has to fit on the bus: a cycle of 2 kHz with one strange frame takes 92 % of
# 1 Mbit/s, with two 119 %.
BABBLE_FRAMES = 1  # frame; see above; of another node before each of the drive's (fault bus-flooded)
PLUGIN_WAIT = 3600.0  # s; chosen; means "for ever": python-can calls again by itself

# One master a bus (bus/other_masters.py)
# A master that moves something sends SYNC or RPDOs.  The slowest cycle that a machine is controlled with is about 50 ms
# (20 Hz); six of them, and three periods of our own heartbeat (100 ms), fit into this time.
LISTENING_TIME = 0.3  # s; see above; silence of other masters before we send anything
LISTENING_FRAMES = 20_000  # frames; chosen; twice what 1 Mbit/s carries meanwhile: a flooded bus ends the listening
LOCK_PATIENCE, LOCK_PAUSE = 0.1, 0.005  # s; chosen; a lock that a killed process or a mere look still has is soon free
LOCK_NAME = 100  # characters; chosen; longest name of a channel in the name of its lock file
LOCK_TEXT = 4096  # bytes; chosen; most that is read of what the holder of a lock says of itself

# ODrive
STATE_CYCLES = 8  # cycles; chosen; distance of two requests for the state, which a feedback line has no room for
LARGEST_TORQUE = 9999.0  # N m; widest number of the command `c`; a larger one is sent as zero
LONGEST_NOISE = 65536  # bytes; chosen; without an end of line they are noise and dropped

# Virtual drives
STILL_TIME = 0.01  # s; chosen; without motion for so long, the virtual drive's stop is over
STOP_GRACE = 2.0  # s; chosen; beyond the ramp: then the virtual drive gives up and cuts the power
CLOCK_TICK = 0.001  # s; chosen; between two looks at the clocks
SYNC_PATIENCE = 0.02  # s; chosen; without SYNC, after which a stopping plant follows the wall clock
CLOCK_SLIP = 1.0  # s; chosen; the plant's wall clock never catches up more than this at once
LOOK_FRAMES = 32  # frames; chosen; read before a partner is declared silent: its frames may still be waiting
JUMP_PERIOD = 0.01  # s; chosen; of encoder-jumping, where none is given
STORM_PERIOD = 1e-3  # s; chosen; of emergency-storm, where none is given
INJECT_DATAGRAM = 65536  # bytes; chosen; largest request or answer of `stagectl inject`
INJECT_TIME = 2.0  # s; chosen; for the virtual drive to answer it
ODRIVE_LINE = 256  # characters; chosen; longest line the virtual ODrive reads: more is noise
