"""CAN frames: real interfaces, the embedded bus, and a bus with faults."""
