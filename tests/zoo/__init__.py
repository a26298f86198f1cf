"""A zoo of foreign CANopen drives, written by another hand than the master: the other end of the bus for its tests.

::

    variants.py   the species: one `Variant` each, data only            objects.py  object dictionary, EDS file
    table.py      what is right for each: moves, refuses, stops         memory.py   stock canopen.LocalNode
    stage.py      stage file and trajectory for a variant               power.py    CiA 402 state machine
    bench.py      starts drive and `run`; judges                        monitors.py heartbeat, guarding, RPDO time-out
    node.py       the process                                           pdos.py     mapping, SYNC
    drive.py      all of it put together, without a bus                 plant.py    screw, friction, weight
    display.py    statusword, mode, position, current as it shows them
    service.py    a service with such a drive                           sample.py   what CI tries of all this
    events.py     what happens in mid-motion                            diary.py    what the drive writes down

No module here imports the master or its virtual drive; the bus is python-can's interface ``stagectl``.

Start a variant by hand, and run a motion against it::

    python -m tests.zoo.stage vertical /tmp/v          # writes stage.yaml, motion.yaml, zoo.eds; prints what follows
    python -m tests.zoo.node vertical --channel /tmp/v/bus --diary /tmp/v/diary.jsonl
    python -m stagectl run /tmp/v/stage.yaml /tmp/v/motion.yaml --channel /tmp/v/bus -o /tmp/v/run.h5
    python -m can.logger -i stagectl -c /tmp/v/bus     # listen

``make zoo`` tries every case of every file; the tests in CI, and the words below, try a sample (`sample.py`) unless
the environment says ``STAGECTL_ZOO=all``.

One row of the table, with the program's own words::

    pytest tests/zoo/test_run.py -k "[vertical]"       # one `run`
    pytest tests/zoo/test_serve.py -k "[vertical]"     # enable, move, disable through a service
    pytest tests/zoo/test_killed.py -k "[vertical]"    # kill -9 of the loop in mid-motion
    pytest tests/zoo/test_reboot.py -k "[17]"          # boots by itself after the 17th SDO of the set-up
    python -m tests.zoo.report run vertical plain ...  # a line each: wanted, seen, the last words; no names: all
    python -m tests.zoo.report serve vertical          # the same with a service

``without:605A00`` is a plain drive that lacks the object 0x605A:00.  A row of the table may give other lines for the
block `drive.wire` (`wire`), so that a key which accepts a lack by name is written in one place.

A test waits for what the drive has written in its diary; no test waits for a time.
"""
