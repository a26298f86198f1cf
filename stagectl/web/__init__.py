"""The live page: what a browser sees of a running service."""
