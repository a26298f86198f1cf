"""Bounds of what is read from configuration files, and of what is written into them.

All are chosen, not derived, unless a line says otherwise: large enough for any file that a person writes, small
enough that no file can keep the program busy.
"""

LARGEST_FILE = 256_000  # bytes of a YAML file; PyYAML takes seconds for more
LARGEST_CSV = 200_000_000  # bytes of a recorded trajectory
DEEPEST_BRACKETS = 50  # brackets within each other on one line; PyYAML's time grows with their square
LONGEST_LIST = 1000  # entries of a list
LONGEST_TEXT = 200  # characters of a text
LONGEST_SHOWN = 60  # characters of a value that a message repeats
MOST_PROBLEMS = 30  # lines of one error message; the first problems are usually the causes of the others
MOST_AXES = 16  # axes of a machine file
MOST_PARTS = 1000  # trajectories within one trajectory file
DEEPEST_PARTS = 40  # blocks within each other of a trajectory file, aliases expanded: two for each trajectory
WIDEST_SLIPS = 1e6  # longest over shortest slip of a rolling friction; beyond, its stiffnesses cancel in a float
DELAY_LINE = 7  # control periods of delay that the plant's kernel holds (`kernels.drive_effects`)
SHORTEST_LEAD, LONGEST_LEAD = 1e-4, 1.0  # m a turn, from a fine screw to a belt's pulley: beyond, the unit is mistaken
FIRST_OBJECT, LAST_OBJECT = 0x1000_00, 0xFFFF_FF  # index_subindex of CANopen objects; below are data types (CiA 301)
# Target torque, actual torque and actual current, in thousandths of the rated ones (CiA 402-2), and the relative
# difference of their scale that is none: a rounded value.
PER_MILLE, SAME_SCALE = (0x6071_00, 0x6077_00, 0x6078_00), 0.01
SLCAN_BAUD = (9600.0, 12e6)  # bit/s that a serial adapter may be set to; the lower end is that of Lawicel's protocol

SAME_VALUE = 1e-6  # relative difference up to which a patched value counts as read back
LINE_WIDTH = 120  # characters of a line in a patched file
WRITTEN_DIGITS = 7  # significant digits of a patched value: half a millionth, less than any identified interval
READABLE = (0.01, 1e4)  # a number outside is written in another unit
