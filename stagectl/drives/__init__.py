"""Drives: the only place that talks to hardware, real or virtual."""
