"""A CiA 402 drive over CANopen: our side of the wire."""
