"""The live page: what a browser sees of a running service, and how little that costs the machine."""
