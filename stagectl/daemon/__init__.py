"""The real-time side: the loop's process, its safety, and the run that starts and watches both."""
