"""Identification: one file a method, offline, over captured buffers."""
