"""Tests on a real CAN interface, and in a guest with systemd and PREEMPT_RT: `python tools/vm`."""
